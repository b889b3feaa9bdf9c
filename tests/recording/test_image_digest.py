"""The digest of a session's images follows names and content, and nothing else; what is known is not read again."""

import os
import shutil

import pytest
from session_folder import write_session

from gelforge.config import Features, load_session
from gelforge.recording import features
from gelforge.recording.imaging import image_digest
from gelforge.recording.imaging.image_digest import images_digest


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A session in a folder where Snakemake runs; its files have been there for a minute."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".snakemake").mkdir()
    return write_session(tmp_path / "day", images=True)


@pytest.fixture
def reads(monkeypatch):
    """Count the files whose content is read; time stamps count as settled at once."""
    read = []
    whole = image_digest.file_sha256
    monkeypatch.setattr(image_digest, "file_sha256", lambda path: read.append(path.name) or whole(path))
    monkeypatch.setattr(image_digest, "SETTLED_NS", -(10**12))
    return read


def test_an_image_that_is_overwritten_changes_the_digests_of_images_and_features(folder, reads):
    # An image that is overwritten in place changes the digest
    before = images_digest(folder)
    path = folder / "images/a_1.png"
    stamp, content = path.stat(), path.read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))  # and its size is the same
    assert images_digest(folder) != before
    assert reads[7:] == ["a_1.png"]
    path.write_bytes(content)
    assert images_digest(folder) == before

    # The digest of features follows the images. A join compares it: a shard of stale features is refused
    session = load_session(folder / "session.yaml")
    before = features.features_digest(folder, session, Features())
    shutil.copy(folder / "images/a_2.png", folder / "images/a_1.png")
    assert features.features_digest(folder, session, Features()) != before


@pytest.mark.parametrize("change", ["reference", "renamed", "added", "removed", "exchanged"])
def test_names_and_the_reference_frame_count(folder, change):
    before, images = images_digest(folder), folder / "images"
    if change == "reference":
        shutil.copy(images / "a_1.png", folder / "reference.png")
    elif change == "renamed":
        (images / "a_1.png").rename(images / "c_1.png")
    elif change == "added":
        shutil.copy(images / "a_1.png", images / "c_1.png")
    elif change == "removed":
        (images / "a_1.png").unlink()
    else:
        (images / "a_1.png").rename(images / "x")
        (images / "a_2.png").rename(images / "a_1.png")
        (images / "x").rename(images / "a_2.png")
    assert images_digest(folder) != before


def test_a_copy_and_a_touch_change_nothing(folder, reads):
    before = images_digest(folder)
    for path in (folder / "images").iterdir():
        os.utime(path)
    (folder / "images/.hidden").touch()
    assert images_digest(folder) == before
    shutil.copytree(folder, folder.parent / "copy")
    assert images_digest(folder.parent / "copy") == before


def test_content_is_read_once_and_again_where_what_was_kept_is_no_use(folder, reads):
    before = images_digest(folder)
    assert len(reads) == 7
    assert images_digest(folder) == before and len(reads) == 7
    kept = next((folder.parent / ".snakemake/images").iterdir())
    kept.write_text("no JSON")
    assert images_digest(folder) == before and len(reads) == 14


def test_a_file_that_has_just_been_written_is_read_again(folder):
    images_digest(folder)
    assert not (folder.parent / ".snakemake/images").exists()


def test_outside_a_folder_of_snakemake_nothing_is_written(folder, reads):
    (folder.parent / ".snakemake").rmdir()
    images_digest(folder)
    assert not (folder.parent / ".snakemake").exists()
