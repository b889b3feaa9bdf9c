"""Recordings that people's reports suggested get their right answer."""

import os
import re
from pathlib import Path

import pytest
from field_case import session_folder, study_file

from gelforge.config import load_study
from gelforge.indentation.planning.plan import plan_cells
from gelforge.recording.readings import read_recording
from gelforge.recording.tables.checks import RecordingError

CASES = Path(os.environ.get("GELFORGE_SHARED", Path(__file__).parents[3] / "shared")) / "field_cases"
FIELD = {
    "rec_good": None,
    "img_good": None,
    "img_good_dots": None,
    "rec_ft_shared_stamps": None,
    "rec_sensor_dies": r"repeats one value to the last digit from indentation p027 on .*27 indentations in all",
    "rec_ft_gap": r"force has no sample in ft\.csv for 1\.\d+ s .*18 indentations in all",
    "rec_tared_drift": r"zero rows of a tared session.*resolution 0\.001 N.*set force\.tared: false",
}


@pytest.mark.skipif(not CASES.is_dir(), reason=f"{CASES} is not here: inputs that people's reports suggested")
@pytest.mark.parametrize("name", FIELD)
def test_field_cases_give_their_right_answer(name, tmp_path):
    study = load_study(study_file(CASES / name / "study.yaml", tmp_path))
    try:
        session = session_folder(CASES / name / "recordings" / "s1", tmp_path)
        recording = read_recording(session, plan_cells(study), study.sensor)
        said = recording.findings.lines("excluded")
    except RecordingError as error:
        said = [str(error)]
    if FIELD[name] is None:
        assert said == []
    else:
        assert len(said) == 1 and re.search(FIELD[name], said[0])
