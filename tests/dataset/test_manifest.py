"""What stands next to the shards: checksums that hold, provenance that is complete, synthetic data called synthetic."""

import hashlib
import json
import shutil
import subprocess

import pytest
from small_dataset import sample_table, small_study, write_cells, write_features

from gelforge.dataset.join import join_shard
from gelforge.dataset.manifest import describe_dataset, read_manifest, verify
from gelforge.dataset.schema import DatasetError
from gelforge.indentation.planning.plan import plan_cells


@pytest.fixture
def described(made):
    for session in made.study.sessions:
        folder = made.study.session_folder(session)
        (folder / "images").mkdir(parents=True)
        (folder / "session.yaml").write_text(f"session: {session}\n")
        for name in sample_table(made.study, session)["image"]:
            (folder / "images" / name).write_text(name)
    made.shards = [made.join("shard-00000.h5", made.names[:5]), made.join("shard-00001.h5", made.names[5:])]
    made.out = made.shards[0].parent
    made.manifest = describe_dataset(made.study, made.shards, made.features, made.out)
    return made


def test_checksums_hold_and_the_manifest_reaches_down_to_raw_files(described):
    # Checksums hold and the same dataset gives the same bytes
    lines = (described.out / "SHA256SUMS").read_text().splitlines()
    names = {"shard-00000.h5", "shard-00001.h5", "manifest.json", "README.md", "croissant.json"}
    assert {line[66:] for line in lines} == names
    for line in lines:
        assert line[:64] == hashlib.sha256((described.out / line[66:]).read_bytes()).hexdigest()
        assert line[64:66] == "  "
    assert verify(described.out) == []

    # The same dataset gives the same bytes
    before = {path.name: path.read_bytes() for path in described.out.iterdir()}
    describe_dataset(described.study, described.shards, described.features, described.out)
    assert {path.name: path.read_bytes() for path in described.out.iterdir()} == before

    # Manifest and croissant reach down to cells shards and raw files
    manifest = read_manifest(described.out / "manifest.json")
    assert set(manifest["cells"]) == set(described.names)
    for name, cell in manifest["cells"].items():
        assert cell["sha256"] == hashlib.sha256(described.cells[name].read_bytes()).hexdigest()
        assert cell["inputs_digest"] == f"digest of {name}"
    images = sum(len(sample_table(described.study, session)) for session in described.study.sessions)
    assert len(manifest["raw_files"]) == images + 2
    for raw in manifest["raw_files"]:
        assert raw["sha256"] == hashlib.sha256(open(raw["file"], "rb").read()).hexdigest()
    assert manifest["rows"]["all"] == images == sum(shard["rows"] for shard in manifest["shards"])
    assert manifest["rows"]["train"] + manifest["rows"]["test"] == images

    # Croissant describes every shard
    content = json.loads((described.out / "croissant.json").read_text())
    assert content["@type"] == "sc:Dataset"
    assert content["conformsTo"] == "http://mlcommons.org/croissant/1.1"
    assert {"cr", "sc", "dct", "conformsTo", "isArray"} <= set(content["@context"])
    assert len(content["distribution"]) == 2
    for file, path in zip(content["distribution"], described.shards):
        assert file["@type"] == "cr:FileObject"
        assert file["encodingFormat"] == "application/x-hdf5"
        assert file["contentUrl"] == path.name
        assert file["contentSize"] == f"{path.stat().st_size} B"
        assert file["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert {v["name"] for v in content["variableMeasured"]} >= {"feature", "force_distribution_N"}


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="sha256sum is not installed")
def test_sha256sum_accepts_them_and_notices_a_change(described):
    check = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    assert subprocess.run(check, cwd=described.out, capture_output=True).returncode == 0
    with open(described.shards[1], "ab") as handle:
        handle.write(b"x")
    assert subprocess.run(check, cwd=described.out, capture_output=True).returncode == 1
    assert verify(described.out) == ["shard-00001.h5"]


def test_synthetic_recordings_are_called_so(described):
    assert "SYNTHETIC" in (described.out / "README.md").read_text()[:200]
    assert "SYNTHETIC" in json.loads((described.out / "croissant.json").read_text())["description"]
    for session in described.study.sessions:
        write_features(
            described.features[session],
            described.study,
            sample_table(described.study, session),
            synthetic=False,
        )
    shards = [described.join("shard-00000.h5", described.names)]
    manifest = describe_dataset(described.study, shards, described.features, described.out)
    assert manifest["synthetic"] is False
    assert "SYNTHETIC" not in (described.out / "README.md").read_text()


def test_labels_only_and_failed_cells_are_said(tmp_path):
    study = small_study(tmp_path, sessions=())
    cells = write_cells(study, tmp_path, failed=["x0_y2"])
    shard = tmp_path / "dataset" / "shard-00000.h5"
    join_shard(study, list(plan_cells(study)), cells, {}, shard)
    manifest = describe_dataset(study, [shard], {}, shard.parent)
    text = (shard.parent / "README.md").read_text()
    assert manifest["labels_only"] is True
    assert manifest["failed_cells"] == {"x0_y2": "no equilibrium at 1 mm"}
    assert "Labels only" in text
    assert "`x0_y2`: no equilibrium at 1 mm" in text
    assert "`feature`" not in text


def test_shards_of_two_datasets_are_refused(described):
    described.study = described.study.model_copy(update={"seed": 5})
    other = described.join("shard-00001.h5", described.names[5:])
    with pytest.raises(DatasetError, match="settings_digest is"):
        describe_dataset(described.study, [described.shards[0], other], described.features, described.out)
    with pytest.raises(DatasetError, match="is also in"):
        describe_dataset(described.study, [other, other], described.features, described.out)
