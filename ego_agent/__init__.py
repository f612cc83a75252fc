"""The ego agent: the MAPE-K loop that decides who takes part in the fusion and how."""
