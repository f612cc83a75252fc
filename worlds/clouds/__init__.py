"""Files of one point cloud, by format; `worlds/scans.py` reads any of them."""
