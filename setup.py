"""What pyproject.toml cannot say: a wheel holds the workflow's rules and the example studies inside the package.

gelforge/shipped.py finds them there, and in a checkout or an editable installation where they are.
"""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent
SHIPPED = {
    "workflow/Snakefile": "workflow/Snakefile",
    "workflow/rules": "workflow/rules",
    "workflow/profiles": "workflow/profiles",
    "config": "examples/config",
    "data/README.md": "examples/data/README.md",
    "data/benchmark": "examples/data/benchmark",
    "data/demo": "examples/data/demo",
    "data/paper": "examples/data/paper",
    "data/gelsight_mini": "examples/data/gelsight_mini",
}
MADE = shutil.ignore_patterns("recordings", "virtual_truth", "__pycache__")  # by runs in this checkout


class WithShippedFiles(build_py):
    def run(self):
        super().run()
        if self.editable_mode:
            return
        for source, target in SHIPPED.items():
            to = Path(self.build_lib, "gelforge", target)
            to.parent.mkdir(parents=True, exist_ok=True)
            if (ROOT / source).is_dir():
                shutil.copytree(ROOT / source, to, ignore=MADE, dirs_exist_ok=True)
            else:
                shutil.copy(ROOT / source, to)


setup(cmdclass={"build_py": WithShippedFiles})
