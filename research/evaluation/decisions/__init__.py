"""Who decides as well as `coverage` from the short prompt: language models and their controls."""
