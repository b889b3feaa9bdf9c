"""`print(gf.judge(...))` shows the verdict in a few lines."""

import fake_verdict

from gelforge.mismatch.result.verdict import Verdict


def test_a_verdict_is_printed_with_its_state_sentence_and_groups():
    verdict = Verdict.model_validate(fake_verdict.fake_content())
    lines = str(verdict).splitlines()
    assert repr(verdict) == str(verdict) and len(lines) == 3 + len(verdict.answer)
    assert verdict.state in lines[0] and verdict.sentence in lines[1]
