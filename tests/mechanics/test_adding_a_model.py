"""The example of docs/adding/constitutive-model.md is a whole model, and docs/constitutive-models.md is up to date."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from docs.models_table import PAGE, page
from gelforge.mechanics.laws.models import MODELS

HERE = Path(__file__).parent
EXAMPLE = Path("docs/adding/examples/demiray.py")


def test_file_and_models_agree():
    assert PAGE.read_text(encoding="utf-8") == page(MODELS), "python docs/models_table.py"


def test_the_guides_example_is_a_model(tmp_path):
    """As printed it enters by its file: given, fitted, kept in law.json, and in an element as compiled loops see it.

    Next to it two laws whose routines are of other kinds: of the stretches, and with mixed derivatives.
    """
    shutil.copy(EXAMPLE, tmp_path)
    paths = os.pathsep.join([os.getcwd(), str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": paths}
    command = [sys.executable, str(HERE / "one_more_model.py"), str(tmp_path), str(HERE / "more_models")]
    run = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
