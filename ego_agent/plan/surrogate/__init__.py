"""A learned estimate of Q(P, a): a small network, trained on what choices really brought."""
