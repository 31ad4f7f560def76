"""Builds in a folder for temporary files, so that an installation leaves nothing in the checkout. All metadata are in pyproject.toml."""

import tempfile

from setuptools import setup

with tempfile.TemporaryDirectory(prefix="softtwin-") as folder:
    setup(options={"build": {"build_base": folder}, "egg_info": {"egg_base": folder}})
