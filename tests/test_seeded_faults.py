"""The faults of `python -m benchmarks.faults code` are in the code as it is, and each names tests that there are."""

from benchmarks.fault_kinds.code import FAULTS, ROOT, spoilt


def test_every_seeded_fault_has_its_text_and_its_tests():
    assert len({fault.battery for fault in FAULTS}) >= 30
    for fault in FAULTS:
        text = (ROOT / fault.path).read_text(encoding="utf-8") if fault.whole else ""
        assert spoilt(text, fault) != text, fault.battery
        for name in fault.tests.partition(" -k ")[0].split():
            assert (ROOT / name).is_file(), fault.battery
