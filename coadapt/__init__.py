"""The command line `coadapt`, the way to everything."""
