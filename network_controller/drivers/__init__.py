"""Drivers: what shapes and reads links in one kind of runtime, behind one small interface."""
