"""The command line `coadapt`, the door to everything."""
