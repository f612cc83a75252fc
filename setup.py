"""The loops in C; all else is in pyproject.toml, whose own way to tell of them is experimental.

All are optional: an installation without a compiler, or whose compiler does not know an instruction
set, does without (perception/kernels/library.py).
"""

import shutil

from setuptools import Extension, setup
from setuptools.command.build import build

NETWORK = {
    "avx512": ["-mavx2", "-mfma", "-mavx512f", "-mprefer-vector-width=512"],
    "avx2": ["-mavx2", "-mfma"],
    "plain": [],
}


def loops(
    name: str, source: str, flags: list[str], folder: str = "perception/kernels"
) -> Extension:
    """A library beside its source."""
    return Extension(
        f"{folder.replace('/', '.')}.{name}",
        [f"{folder}/{source}.c"],
        extra_compile_args=["-O3", "-pthread", *flags],
        extra_link_args=["-pthread"],
        depends=["perception/kernels/team.h"],
        optional=True,
    )


class FreshBuild(build):
    """Takes nothing from what an earlier build left, such as modules that are gone."""

    def run(self) -> None:
        """Builds into an empty folder."""
        shutil.rmtree(self.build_lib, ignore_errors=True)
        super().run()


setup(
    cmdclass={"build": FreshBuild},
    ext_modules=[
        *(loops(f"_network_{name}", "network", flags) for name, flags in NETWORK.items()),
        loops("_coding", "coding", []),
        loops("_places", "places", []),
        loops("_rays", "rays", ["-ffp-contract=off"], "worlds/factory"),
    ],
)
