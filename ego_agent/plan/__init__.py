"""Plan: policies propose who takes part and how; validation decides."""
