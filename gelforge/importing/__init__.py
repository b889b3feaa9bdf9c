"""Raw logs of a laboratory to a session folder: `gelforge import`.

    streams.py        a log as times and values in s, N and mm
    stage_motion.py   excursions of the stage, where it stands still, when it stops and leaves
    clocks.py         candidate lags by correlation, and which of them the presses contradict
    turning_points.py the lag of each stop and start, and the law of the clock that they make
    contact.py        the contact point of a press with its interval
    presses.py        presses with their phases; what slips, is cut off or never touches
    camera.py         when frames were taken, how far each differs from the first, and frames as files
    session_files.py  session.yaml, indentations.csv, ft.csv, images
    importer.py       all of it in turn

The clock of the session is the stage's, from its first row on. A lag is how much later another clock shows the same moment.
"""
