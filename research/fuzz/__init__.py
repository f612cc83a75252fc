"""Coverage-guided fuzzing of everything that reads bytes of others (`make fuzz`).

A target hands an input to a decoder and names the errors that its docstring allows. `worker` lets
atheris look for inputs that end otherwise, take a second of the processor or a hundred megabytes;
`trial` repeats what it found, alone in a process of its own, and only that makes it a finding.
"""
