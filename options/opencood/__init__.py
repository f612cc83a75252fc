"""Models trained with OpenCOOD (Xu et al., "OPV2V", ICRA 2022), run on its checkpoints.

Needs torch; `config` does without it. docs/opencood.md tells how to bring a checkpoint.
"""
