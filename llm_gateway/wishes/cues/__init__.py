"""Words by which a wish tells what is to be done with what it names, in English and German.

Patterns read a clause as `clauses` writes it: folded words, and what is named in capitals.
"""
