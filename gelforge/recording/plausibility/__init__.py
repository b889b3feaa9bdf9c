"""Tests of a recorded session as a whole, before any simulation: can these readings and images be true?

Every test is a function that takes a `SessionData` and returns findings (`list[Finding]`); `session.TESTS` names all of
them, and `readings.read_recording` runs them, so that `check`, `readings`, `features`, `join` and `mismatch` share one set.
`apply_findings` takes the excluded channel, force or image, out of the named rows before anything downstream reads them.

To add a test: write `def name(data: SessionData) -> list[Finding]`, name it in `session.TESTS`, and describe it below with
its limit and remedy; `make generated` writes docs/recording-tests.md from there. Rows are labels of `data.readings.index`
(lines of indentations.csv). A test neither changes the data nor raises; it returns [] where the session lacks what it needs
(no images, one site only). One Finding is one indentation, or the session as a whole (`press=""`).

## Forces

The *floor* of an axis combines resolution and scatter at rest.

| test | finds | limit | consequence; remedy |
|:--|:--|:--|:--|
| `gap` | a reading in a gap of `ft.csv` | 3 periods of the log, at least 40 ms | excluded; record without gaps |
| (reader) | readings outside the log; time that runs back; shared stamps | 1 s; 0.1 s | error; one clock for both files |
| `mirrored_axes` | `force.axes` that mirror a right-handed stage | determinant -1 | error; a sign, or `handedness: left` |
| `force_in_step` | force that lags or leads the depth | earliest dwell, >= 0.15 s and two periods | error; `force.delay_s` |
| `force_before_touch` | tared zero rows that read a force | 5 floors, 1 % of the largest | error; `force.tared: false` |
| | force that changes before contact | 15 floors, a fifth of the force | excluded; zero rows clear of the surface |
| `force_saturates` | a largest value that repeats | chance 1e-6, or 3 steps too little | excluded there; larger range |
| `force_repeats` | equal digits while the depth changes | 3 times resolution and scatter | excluded; check plug and supply |
| `force_answers` | no force where the site answered no deeper | 5 floors | excluded; an error if nothing answers |
| `force_grows` | much less force than at a depth 1.5 times smaller | 0.4 of proportional | excluded; check both |
| `force_spikes` | one reading far from those before and after it | 15 floors, a fifth of the force | that reading excluded |
| `planned_count` | fewer indentations than planned at visited sites | | note |

## Images

`check`, `readings`, `join` and `mismatch` test up to 24 indentations of a session, `features` all images.

| test | finds | passes |
|:--|:--|:--|
| `image_readable` (error) | an image that is missing, cut or of another size | PNG, TIFF, JPEG, BMP of 8 and 16 bits |
| `image_content` | less than a tenth of the reference's texture or light | dark corners, a dim session |
| `image_content` (error) | a reference frame of less than 16 grey levels | |
| `image_bands` | bands 30 % brighter or darker, also in a tenth of untouched images | shading by the indenter |
| `image_exposure` | brightness that steps by more than 15 % from before contact to depth | lamps that warm |
| `image_repeats` | an image equal to an earlier one though the surface moved by 0.1 px | a noiseless camera at rest |
| `image_in_step` (error) | images that lag or lead by up to 3, fit no row, or do not answer | shallow ones (a note) |
| `image_before_touch` | one image before contact that moves by 30 % of the flow under load | an offset of all images |
| `image_alike` | one image with half or twice the flow of its indentation at that depth | relaxation |
| `image_grows` | less flow than 70 % of that at smaller depths of the same place | unloading; places out of sight |
"""
