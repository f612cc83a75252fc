"""Benchmarks; each writes one JSON file under build/bench/."""
