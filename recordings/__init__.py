"""Recordings of running swarms: written as MCAP, shown live in Foxglove, replayed and compared."""
