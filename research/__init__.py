"""Research: experiments, training and benchmarks; not installed with the product."""
