"""The classifier among the baselines: it sees a written recording as a drawn one, and learns what it is shown."""

import numpy as np
import pytest

pytest.importorskip("felupe", reason="FElupe is not installed: pip install -e .[verification]")
pytest.importorskip("sklearn", reason="scikit-learn is not installed: pip install -e .[learning]")
from validation import classifier, draw
from validation.baselines import table_of
from validation.recording import write_recording


def test_features_of_a_written_recording_are_those_of_the_drawn_one(library, tmp_path):
    (case,) = draw.cases({"small": library}, 5, {"single": 1})
    write_recording(tmp_path, case.name, case.rows, case.readings, case.instrument)
    drawn = classifier.features(classifier._table(library, case))
    # times and depths are written to 1e-6: of a residual of some hundred standard deviations, weighed over 400 rows
    written = classifier.features(table_of(library, tmp_path, case.truth))
    np.testing.assert_allclose(written, drawn, atol=1e-2)


@pytest.mark.thorough
def test_it_tells_a_strong_effect_from_nothing(library, monkeypatch):
    """Gains against nulls: a gain of SNR 20 and more is in every average, so few of each are enough."""
    monkeypatch.setattr(draw, "KINDS", {"amplifier gains": draw.KINDS["amplifier gains"]})
    libraries = {"small": library}
    learned = classifier.trained(libraries, "concealed", 60, least=20.0)
    shown = draw.cases(libraries, 6, {"null": 3, "single": 3}, least=20.0)
    for case in shown:
        table = classifier._table(library, case)
        (found,) = learned.model.predict(classifier.features(table)[None])
        assert found == (case.truth["effects"][0]["name"] if case.truth["effects"] else classifier.NULL)
