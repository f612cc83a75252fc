"""Subcommands of `coadapt`, one module each.

A module offers `register(subparsers)`, which adds its parser and sets `run` to a function from the
parsed arguments to an exit status. Modules import what is heavy inside `run`, so that
`coadapt --help` stays quick.
"""
