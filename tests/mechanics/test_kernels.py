"""The compiled element loop against its NumPy twin, on distorted elements and at stretches that coincide."""

import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import specimens
import twins
from numba.extending import is_jitted
from numpy.testing import assert_allclose

import gelforge
from gelforge.mechanics.bodies.body import Body, bulk_to_shear_of
from gelforge.mechanics.bodies.kernels import ASSEMBLE, ASSEMBLE_WITH_MEMORY, CODE
from gelforge.mechanics.laws.corrected import Corrected
from gelforge.mechanics.laws.models.gent import Gent
from gelforge.mechanics.laws.models.mooney_rivlin import MooneyRivlin
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.laws.models.yeoh import Yeoh
from gelforge.mechanics.linear.sparsity import build_pattern
from gelforge.mechanics.meshes.elements import ELEMENTS

COMPILED = (
    *(
        "mechanics.bodies.kernels",
        "mechanics.bodies.layout",
        "mechanics.bodies.node_sums",
        "mechanics.bodies.point_stress",
    ),
    *("mechanics.laws.points", "mechanics.contact.forces"),
    *(
        "mechanics.indenters.closed_surface",
        "mechanics.linear.sparsity",
        "mechanics.solving.corrections",
        "mechanics.meshes.elements",
        "indentation.effects.fields",
        "recording.features",
        "virtual_lab.imaging",
    ),
)
rng = np.random.default_rng(11)
LAWS = {
    "gel": specimens.GEL,
    "skin": specimens.SKIN,
    "neo_hooke_of_ogden": Ogden((0.1,), (2.0,)),
    "three_terms": Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0)),
    "neo_hooke": NeoHooke(0.1),
    "mooney_rivlin": MooneyRivlin(0.08, 0.02),
    "yeoh": Yeoh(0.05, -1e-3, 5e-5),
    "gent": Gent(0.1, 60.0),
    "corrected": Corrected(specimens.GEL, 2e-3, -3e-4),
    "corrected_of_invariants": Corrected(Gent(0.1, 60.0), -0.01, 2e-3),
    "gent_close": Gent(0.1, 2.0),  # the states below reach up to 0.98 of its limit
}
HEXAHEDRON = specimens.distorted(specimens.box(1), 0.2, rng, boundary=True)
KUHN = specimens.distorted(specimens.tetrahedral(specimens.box(1)), 0.2, rng, boundary=True)
_used, _renumbered = np.unique(KUHN.elements[2], return_inverse=True)
TETRAHEDRON = replace(
    KUHN,
    X=KUHN.X[_used] + 0.03 * rng.uniform(-1, 1, (10, 3)),  # edges not straight
    elements=_renumbered[None].astype(np.int32),
    region=KUHN.region[:1],
    fixed=np.zeros(10, bool),
)
MESHES = {"hexahedron": HEXAHEDRON, "tetra10": TETRAHEDRON}

TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
# An affine part and the size of a random one, of the element's.
DISPLACEMENTS = {
    "none": (np.eye(3), 0.0),
    "random": (np.eye(3), 0.15),
    "turned and random": (TURN, 0.15),
    "two stretches equal": (np.diag([1.3, 1.3, 0.6]), 0.0),
    "nearly equal": (np.diag([1.3, 1.3 + 1e-6, 0.6]), 0.0),
    "barely apart": (np.diag([1.3, 1.3 + 1e-4, 0.6]), 0.0),
    "three equal": (1.1 * TURN, 0.0),
}
elements = pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES.keys())


def displacement(mesh, name):
    """Return u (A, 3) at the nodes of the only element."""
    X = mesh.X[mesh.elements[0]]
    F, size = DISPLACEMENTS[name]
    random = np.random.default_rng(5).uniform(-1, 1, X.shape)
    if len(X) == 10:  # the slopes of a quadratic field are four times those of the same values at corners
        random /= 4
    return X @ (F - np.eye(3)).T + size * random


def kernel(mesh, law, u, p, bulk_to_shear=1000.0, stiffness=None):
    """Return the compiled element's response and its dense tangent (3 A, 3 A)."""
    A = len(mesh.X)
    free = build_pattern(mesh.elements, np.zeros(A, bool))
    body = Body(mesh, {"gel": law}, bulk_to_shear, free, stiffness)
    values = np.empty(len(free.indices))
    at_nodes = np.empty((A, 3))
    at_nodes[mesh.elements[0]] = u
    response = body.response(at_nodes, np.array([p]), values)
    dense = np.zeros((3 * A, 3 * A))
    rows = np.repeat(np.arange(3 * A), np.diff(free.indptr))
    dense[rows, free.indices] = dense[free.indices, rows] = values
    order = free.equation[mesh.elements[0]].ravel()
    return response, dense[np.ix_(order, order)]


@elements
@pytest.mark.parametrize("state", DISPLACEMENTS)
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_kernel_equals_its_twin(mesh, law, state):
    u = displacement(mesh, state)
    p = -0.3 * law.shear_modulus
    bulk = 1000.0 * law.shear_modulus
    response, tangent = kernel(mesh, law, u, p)
    node = mesh.elements[0]
    local = ELEMENTS[len(node)].local_bulk_to_shear * law.shear_modulus
    twin = twins.element(mesh.X[node], u, p, law, bulk, local)
    # Forces: stresses of size mu; f_condensed and p_volume carry the rounding of K (theta - 1), K = 1000 mu.
    mu = law.shear_modulus
    assert_allclose(response.f_mixed[node], twin["f_mixed"], rtol=1e-10, atol=1e-12 * mu)
    assert_allclose(response.f_condensed[node], twin["f_condensed"], rtol=1e-10, atol=1e-11 * mu)
    assert_allclose(response.p_volume[0], twin["p_volume"], rtol=1e-10, atol=1e-11 * mu)
    assert_allclose(response.coupling[0], twin["coupling"], rtol=1e-11, atol=1e-14)
    assert_allclose(response.energy, twin["energy"], rtol=1e-10, atol=1e-14 * mu)
    # Near equal stretches the quotient of differences loses up to five digits, hence 1e-9 of the modulus.
    scale = np.abs(twin["tangent"] - bulk * np.outer(twin["coupling"], twin["coupling"])).max()
    assert_allclose(tangent, twin["tangent"], rtol=1e-9, atol=1e-9 * min(scale, mu))


@elements
def test_factors_on_the_stiffness_and_pressures_act_as_they_are(mesh):
    """The element with factor 2.5 is the one whose moduli are all 2.5 times larger, its bulk modulus too."""
    u, p = displacement(mesh, "random"), -2e-3
    scaled = Ogden([2.5 * m for m in specimens.GEL.mu], specimens.GEL.alpha)
    one, tangent = kernel(mesh, specimens.GEL, u, p, stiffness=np.array([2.5]))
    other, expected = kernel(mesh, scaled, u, p)
    size = np.abs(expected).max()
    for name in ("f_mixed", "f_condensed", "p_volume", "coupling", "energy"):
        a, b = getattr(one, name), getattr(other, name)
        assert_allclose(a, b, rtol=1e-13, atol=1e-15 * size)  # the order of two products
    assert_allclose(tangent, expected, rtol=1e-12, atol=1e-14 * size)

    # Factor one changes no bit
    (one, tangent), (other, expected) = (
        kernel(mesh, specimens.GEL, u, p, stiffness=factor) for factor in (None, np.ones(1))
    )
    assert np.array_equal(tangent, expected)
    for name in ("f_mixed", "f_condensed", "p_volume", "coupling", "energy"):
        assert np.array_equal(getattr(one, name), getattr(other, name))

    # F_mixed follows the given pressure, f_condensed does not: what makes the iteration a mixed
    # one.
    u = displacement(mesh, "random")
    (one, _), (other, _) = kernel(mesh, specimens.GEL, u, 0.0), kernel(mesh, specimens.GEL, u, 0.02)
    by_number = one.coupling[0][np.argsort(mesh.elements[0])]
    assert_allclose(other.f_mixed - one.f_mixed, 0.02 * by_number, atol=1e-15)
    assert np.array_equal(one.f_condensed, other.f_condensed)


@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (np.ones(3), r"shape \(3,\); one factor for each of 1 elements"),
        (np.zeros(1), "element 0 is 0; > 0"),
        (np.array([np.nan]), "element 0 is nan"),
    ],
)
def test_factors_without_a_meaning_are_refused(factor, message):
    with pytest.raises(ValueError, match=message):
        Body(HEXAHEDRON, {"gel": specimens.GEL}, 1000.0, stiffness=factor)


def test_limits_of_extension_and_of_poissons_ratio_are_kept():
    # Beyond a limiting extension numbers stay finite and are not admissible
    law = Gent(0.1, 0.5)
    for amount, inside in ((1.3, True), (1.6, False), (5.0, False)):
        stretch = np.diag([amount, amount**-0.5, amount**-0.5])
        u = HEXAHEDRON.X[HEXAHEDRON.elements[0]] @ (stretch - np.eye(3)).T
        response, tangent = kernel(HEXAHEDRON, law, u, 0.0)
        extension = (amount**2 + 2 / amount - 3) / 0.5
        assert response.largest_extension == pytest.approx(extension, rel=1e-10)
        assert response.admissible == inside
        for values in (response.f_mixed, response.f_condensed, response.energy, tangent):
            assert np.isfinite(values).all()

    # Bulk to shear is that of poissons ratio
    assert bulk_to_shear_of(0.0) == pytest.approx(2 / 3)  # K = E/3, mu = E/2
    assert bulk_to_shear_of(0.4995) == pytest.approx(1000, rel=1e-3)
    with pytest.raises(ValueError, match=r"Poisson's ratio is 0.5"):
        bulk_to_shear_of(0.5)


@elements
@pytest.mark.parametrize("J", [0.4, -0.4])
def test_smallest_volume_ratio(mesh, J):
    u = mesh.X[mesh.elements[0]] * [0, 0, J - 1]
    response, _ = kernel(mesh, specimens.GEL, u, 0.0)
    assert response.smallest_J == pytest.approx(J, rel=1e-12)
    assert response.admissible == (J > 0)


@pytest.mark.parametrize(
    "skin", ["gent", "corrected_of_invariants"]
)  # of two families; with a correction and without
@pytest.mark.parametrize("bulk_to_shear", [50.0, {"gel": 50.0, "skin": 3.0}], ids=["one", "by region"])
def test_regions_take_their_own_law_and_bulk_modulus(bulk_to_shear, skin):
    """Two elements of different regions: each with the forces that its own law gives alone."""
    mesh = specimens.layered_block(
        specimens.Block(1.0, 1.0, (("gel", 1.0), ("skin", 1.0))),
        0.5,
        0.5,
        specimens.Sizes(near=1.0, far=1.0),
    )
    assert len(mesh.elements) == 2
    laws = {"gel": specimens.GEL, "skin": LAWS[skin]}
    u = 0.1 * rng.uniform(-1, 1, mesh.X.shape)
    response = Body(mesh, laws, bulk_to_shear).response(u, np.zeros(2))
    expected = np.zeros_like(u)
    for nodes, region in zip(mesh.elements, mesh.region):
        name = mesh.regions[region]
        ratio = bulk_to_shear[name] if isinstance(bulk_to_shear, dict) else bulk_to_shear
        twin = twins.element(mesh.X[nodes], u[nodes], 0.0, laws[name], ratio * laws[name].shear_modulus)
        expected[nodes] += twin["f_condensed"]
    assert_allclose(response.f_condensed, expected, rtol=1e-10, atol=1e-14)


def test_an_element_does_not_depend_on_those_beside_it():
    """Elements of two regions, interleaved: each has what it has alone to the last bit; sums are theirs in any order."""
    mesh = specimens.distorted(specimens.box(3), 0.2, rng)
    region = rng.integers(0, 2, len(mesh.elements)).astype(np.int32)
    mesh = replace(mesh, regions=("gel", "skin"), region=region)
    body = Body(mesh, {"gel": specimens.GEL, "skin": LAWS["gent"]}, 1000.0)
    u, p = 0.05 * rng.uniform(-1, 1, mesh.X.shape), 0.1 * rng.uniform(-1, 1, len(region))
    u[0] *= 3.0  # some need more rotations than others
    tangent = np.empty(len(body.pattern.indices))
    whole = body.response(u, p, tangent)
    f_mixed, energy, smallest = np.zeros_like(u), 0.0, np.inf
    for e in range(len(region)):
        one = np.array([e])
        alone = body.part(one, replace(mesh, elements=mesh.elements[one], region=region[one])).response(
            u, p[one]
        )
        assert np.array_equal(alone.coupling[0], whole.coupling[e])
        assert alone.p_volume[0] == whole.p_volume[e]
        f_mixed, energy, smallest = (
            f_mixed + alone.f_mixed, energy + alone.energy, min(smallest, alone.smallest_J),
        )  # fmt: skip
    assert_allclose(whole.f_mixed, f_mixed, rtol=0, atol=1e-15 * np.abs(f_mixed).max() * len(region))
    assert whole.energy == pytest.approx(energy, rel=1e-14)
    assert whole.smallest_J == smallest
    order = rng.permutation(len(region))
    turned = replace(mesh, elements=mesh.elements[order], region=region[order])
    other, again = Body(turned, body.laws, 1000.0), np.empty_like(tangent)
    response = other.response(u, p[order], again)
    assert np.array_equal(response.coupling, whole.coupling[order])
    assert_allclose(again, tangent, rtol=0, atol=1e-14 * np.abs(tangent).max())
    body.response(u, p, again)
    assert np.array_equal(again, tangent)


def compiled_functions():
    """Return the compiled functions that are kept on disk by their names; those of a table by their number of nodes too.

    Others are compiled into those that call them.
    """
    modules = (import_module(f"gelforge.{name}") for name in COMPILED)
    named = [(module.__name__, *item) for module in modules for item in vars(module).items()]
    tables = [(m, f"{name}[{key}]", f) for m, name, v in named if isinstance(v, dict) for key, f in v.items()]
    return {
        f"{m}.{name}": function
        for m, name, function in named + tables
        if is_jitted(function) and function.stats.cache_path
    }


@pytest.mark.parametrize("name", compiled_functions())
def test_what_is_compiled_is_found_again_by_the_next_process(name):
    """On disk it is known by its code and what it closes over: a compiled function is another one in every process."""
    cells = compiled_functions()[name].py_func.__closure__ or ()
    assert all(type(cell.cell_contents) in (int, bool, float) for cell in cells)


def test_every_module_that_compiles_is_known_by_its_laws():
    """What a law's routine computes is not in the code of the kernel that holds it: what tells them apart is closed over."""
    for kernel in (*ASSEMBLE.values(), *ASSEMBLE_WITH_MEMORY.values()):
        assert CODE in [cell.cell_contents for cell in kernel.py_func.__closure__]

    # Every module that compiles is among them
    package = Path(gelforge.__file__).parent
    compiling = [path for path in package.rglob("*.py") if re.search(r"@(nb|numba)\.njit", path.read_text())]
    assert {".".join(path.relative_to(package).with_suffix("").parts) for path in compiling} == set(COMPILED)
