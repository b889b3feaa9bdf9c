"""Files of another kind than is wanted: one line that says what they are, and what is needed."""

import numpy as np
import pytest

from gelforge.cli import main

VIDEO = b"\0\0\0\x20ftypisom" + bytes(64)
NEEDED = {
    "predict film.mp4 --model study.yaml": "study.yaml: is a YAML file; name a file that gelforge has written",
    "predict film.mp4 --model folder": "folder: is a folder; name a file in results/<study>",
    "predict film.mp4 --model film.mp4": "film.mp4: is a video (MP4); name a file that gelforge has written",
    "predict film.mp4 --model m.onnx --reference film.mp4": "film.mp4: is a video (MP4), an image is needed; name a PNG, "
    "TIFF, BMP or JPEG (one frame of a video: ffmpeg -i film.mp4 -frames:v 1 frame.png)",
    "predict film.mp4 --model m.onnx --reference folder": "folder: is a folder, an image is needed",
    "live film.mp4 --model m.onnx --reference study.yaml": "study.yaml: is a YAML file, an image is needed",
    "calibrate-camera film.mp4 --board 9x6 --square-mm 3 --out c.yaml": "film.mp4: is a video (MP4), a folder is needed; "
    "name the folder with the images of the board (of a video: ffmpeg -i film.mp4 -r 2 FOLDER/%04d.png)",
    "show study.yaml": "study.yaml: is a YAML file; name a file that gelforge has written, in results/<study>",
    "explain folder 3": "folder: is a folder; name a file in results/<study>",
    "press --x 5 --y 5 --depths 0.3 --indenter picture.png": "picture.png: is an image (PNG), a YAML file is needed",
    "press --x 5 --y 5 --depths 0.3 --laws study.yaml": "study.yaml: is a YAML file; name a file that gelforge has written",
    "check film.mp4": "film.mp4: is a video (MP4), a YAML file is needed",
    "check model.pt": "model.pt: is an archive (ZIP, or PyTorch's), a YAML file is needed",
    "characterise film.mp4 --mapping picture.png --out o": "picture.png: is an image (PNG), a YAML file is needed",
    "import-set table film.mp4 --columns image=a fx=b fy=c fz=d --out o": "is a video (MP4), a table (CSV) is needed",
    "import-set feats study.yaml --out o": "study.yaml: no .npz or .npy file; name a folder of the set, or one of its files",
    "mismatch film.mp4 --study study.yaml --out o": "is a video (MP4), a folder is needed; name a session's folder",
    "export dataset --format croissant --results study.yaml --out o": "a file stands in the place of a folder",
    "plan --study study.yaml --out folder": "folder: is a folder, and a file is written; name a file",
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Be in a folder with a file of each kind; the models are not read before what is wrong is found."""
    (tmp_path / "film.mp4").write_bytes(VIDEO)
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n" + bytes(32))
    np.savez(tmp_path / "model.npz", a=np.zeros(2))
    (tmp_path / "model.npz").rename(tmp_path / "model.pt")
    (tmp_path / "folder").mkdir()
    (tmp_path / "study.yaml").write_text(
        "study: small\n"
        "sensor: {width_x_mm: 12, width_y_mm: 12, wall_mm: 0, layers: [{name: gel, thickness_mm: 4, material: gel}]}\n"
        "materials: {gel: {parameters: {law: neo_hooke, mu_kPa: 20}}}\n"
        "indenter: {kind: sphere, radius_mm: 3}\n"
        "plan: {grid: {spacing_mm: 3, margin_mm: 5}, depths_mm: [0.5]}\n"
    )
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("command", NEEDED)
def test_a_file_of_another_kind_is_named_with_the_remedy(here, command, capsys):
    assert main(command.split()) == 1
    printed = capsys.readouterr()
    assert NEEDED[command] in printed.err and printed.err.count("\n") == 1
    assert "Traceback" not in printed.err
