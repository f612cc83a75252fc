"""Policies side by side on the same control windows: decisions, tables, figures."""
