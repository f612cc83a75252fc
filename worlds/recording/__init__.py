"""Recordings of swarms (`coadapt record`) as a world."""
