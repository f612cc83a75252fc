"""The network control layer: shapes links with `tc`, measures them, and moves bandwidth slowly."""
