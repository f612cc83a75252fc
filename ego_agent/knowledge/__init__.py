"""Knowledge: the objective, what was learnt, the journal, and the values that stages share."""
