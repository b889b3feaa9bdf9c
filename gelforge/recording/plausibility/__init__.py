"""Tests of a recorded session as a whole, before any simulation: can these readings and images be true?

Every test is a function that takes a `SessionData` and returns findings (`list[Finding]`); `session.TESTS` names all of
them, and `readings.read_recording` runs them, so that `check`, `readings`, `features`, `join` and `mismatch` share one set:

    forces.py       force before contact, its answer to the indentation, its growth with depth, values that repeat
    saturation.py   force at a largest value without noise
    spikes.py       single readings beyond those before and after
    timing.py       force that lags or leads the depth
    streams.py      gaps and shared stamps of ft.csv
    positions.py    mirrored axes, indentations recorded beside those planned
    images.py       images

A finding has one of three levels. `error`: the session is refused, in one line. `excluded`: the named rows lose one channel,
`force` (its three components become NaN) or `image` (its name becomes ""), in `apply_findings`, before anything downstream
reads them; the row itself stays. `note`: information. A laboratory that has looked at what a test found names the test in
`confirmed` of session.yaml; errors and exclusions of that test then become notes.

To add a test: write `def name(data: SessionData) -> list[Finding]`, name it in `session.TESTS`, and describe it with its
limit and its remedy in docs/file-formats.md, "Recordings that cannot be true". Rows are labels of `data.readings.index`
(lines of indentations.csv). A test neither changes the data nor raises; it returns [] where the session lacks what it needs
(no images, one site only). One Finding is one indentation, or the session as a whole (`press=""`).
"""
