"""The northbound API: Quality on Demand in the shape of CAMARA; see docs/qod.md."""
