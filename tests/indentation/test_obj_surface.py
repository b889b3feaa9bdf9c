"""OBJ files as modelling programs write them give the surface of the plain file."""

import numpy as np
import pytest

from gelforge.config import ConfigError
from gelforge.indentation.sensor.indenter_shapes import read_triangles

CORNERS = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (0, 0, 3), (2, 0, 3), (2, 1, 3), (0, 1, 3)]
QUADS = [(4, 3, 2, 1), (5, 6, 7, 8), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8)]


def box(x=0.0, corner=lambda k: f"{k}", quads=QUADS):
    vertices = "".join(f"v {x + a:g} {b:g} {c:g}\n" for a, b, c in CORNERS)
    return vertices + "".join("f " + " ".join(corner(k) for k in quad) + "\n" for quad in quads)


def triangulated():
    return [part for a, b, c, d in QUADS for part in ((a, b, c), (a, c, d))]


def volume(path):
    vertices, triangles = read_triangles(path)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    return float((np.cross(a, b) * c).sum()) / 6


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (box(quads=triangulated()), 6),
        (box(), 6),
        (box(corner=lambda k: f"{k - 9}"), 6),
        (
            box(corner=lambda k: f"{k - 9}") + box(5, lambda k: f"{k - 9}"),
            12,
        ),  # relative to the vertices above
        (
            "o box\nvn 0 0 1\nvt 0 0\nvt 1 0\n"
            + box(corner=lambda k: f"{k}/2/1")
            + "usemtl grey\ns off\nl 1 2\n",
            6,
        ),
        ("vn 0 0 1\n" + box(corner=lambda k: f"{k}//1"), 6),
        (box().replace("v 2 0 0\n", "v 2 0 0 0.1 0.2 0.3  # coloured\n").replace("f 4 3", "f 4 \\\n3"), 6),
    ],
)
def test_ways_of_writing_give_one_volume(tmp_path, text, expected):
    (tmp_path / "a.obj").write_text(text)
    assert volume(tmp_path / "a.obj") == pytest.approx(expected)


def test_faces_of_many_corners_are_cut(tmp_path):
    n, angle = 7, 2 * np.pi * np.arange(7) / 7
    vertices = [f"v {x} {y} {z}" for z in (0, 1) for x, y in zip(np.cos(angle), np.sin(angle))]
    faces = [f"f {i + 1} {(i + 1) % n + 1} {n + (i + 1) % n + 1} {n + i + 1}" for i in range(n)]
    faces += ["f " + " ".join(map(str, range(n, 0, -1))), "f " + " ".join(map(str, range(n + 1, 2 * n + 1)))]
    (tmp_path / "a.obj").write_text("\n".join(vertices + faces))
    assert volume(tmp_path / "a.obj") == pytest.approx(n / 2 * np.sin(2 * np.pi / n))

    # Polygons of a ply file are cut
    corners = [*CORNERS, (1, -0.5, 0), (1, -0.5, 3)]  # a sixth side: both caps have five corners
    capped = [(4, 3, 2, 9, 1), (5, 10, 6, 7, 8), (1, 9, 10, 5), (9, 2, 6, 10), *QUADS[3:]]
    head = f"element vertex {len(corners)}\nproperty float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(capped)}\nproperty list uchar int vertex_indices\nend_header\n"
    body = [" ".join(map(str, point)) for point in corners]
    body += [" ".join(map(str, (len(face), *(k - 1 for k in face)))) for face in capped]
    (tmp_path / "a.ply").write_text("ply\nformat ascii 1.0\n" + head + "\n".join(body) + "\n")
    assert volume(tmp_path / "a.ply") == pytest.approx(6 + 1.5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
            r"line 4: a face of the vertices \[1, 2, 9\], where there are 3",
        ),
        ("v 0 0 0\nv 1 0 0\nf -1 -2 -3\nv 0 1 0\n", "line 3: .*vertex -3 of 2"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "line 4: .* at least three"),
        ("v 0 0 x\n", "line 1: 'v 0 0 x' is no vertex"),
        (
            "v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nf 3 4 1 2\n",
            None,
        ),  # a fan about the corner that points inwards
        ("v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nf 2 3 4 1\n", "not convex; triangulate"),
        ("o nothing\n", "no face"),
    ],
)
def test_what_no_surface_can_be(tmp_path, text, said):
    (tmp_path / "a.obj").write_text(text)
    if said is None:
        assert len(read_triangles(tmp_path / "a.obj")[1]) == 2
        return
    with pytest.raises(ConfigError, match=said):
        read_triangles(tmp_path / "a.obj")
