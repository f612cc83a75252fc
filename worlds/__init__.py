"""Worlds: where scans and ground truth come from. No Zenoh."""
