"""Pictures of what was fused, from above: as SVG, PNG or PDF."""
