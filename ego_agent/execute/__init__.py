"""Execute: asks the chosen robots for frames, fuses them and publishes what was found."""
