"""Programs of others that tools measure the bench beside: from PyPI, in a Python of their own, made once."""

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

CACHE = Path(os.environ.get("BENCH_CACHE", Path.home() / ".cache/bench"))


def python_with(*packages):
    """A Python in the cache with these packages in it, given as `name==version`."""
    folder = CACHE / "python" / "-".join(package.replace("==", "-") for package in packages)
    if not (folder / "complete").exists():
        print(f"setting up {', '.join(packages)} in {folder}", file=sys.stderr)
        shutil.rmtree(folder, ignore_errors=True)
        venv.create(folder, with_pip=True)
        pip = [folder / "bin/python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages]
        subprocess.run(pip, check=True)
        (folder / "complete").touch()
    return folder / "bin/python"
