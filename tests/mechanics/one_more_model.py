"""Try models of further folders, as a process of its own: python one_more_model.py FOLDER_OF_DEMIRAY MORE."""

import sys
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

spec = find_spec("gelforge.mechanics.laws.models")
spec.submodule_search_locations += sys.argv[1:]
sys.modules[spec.name] = models = module_from_spec(spec)
spec.loader.exec_module(models)

import specimens  # noqa: E402
import twins  # noqa: E402

from docs.models_table import page  # noqa: E402
from gelforge.config import LAW_NAMES, Fitting, Material  # noqa: E402
from gelforge.materials.basis.common_form import MaterialTest  # noqa: E402
from gelforge.materials.characterise import given_law  # noqa: E402
from gelforge.materials.fitting.curves import mean_curves  # noqa: E402
from gelforge.materials.fitting.fit import fit_law  # noqa: E402
from gelforge.materials.fitting.law_file import read_law, write_law  # noqa: E402
from gelforge.mechanics.bodies.body import Body  # noqa: E402
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, nominal_stress  # noqa: E402
from gelforge.mechanics.laws.models.gent import Gent  # noqa: E402
from gelforge.mechanics.laws.models.mooney_rivlin import MooneyRivlin  # noqa: E402
from gelforge.mechanics.linear.sparsity import build_pattern  # noqa: E402

given = given_law("gel", Material(parameters={"law": "demiray", "mu_kPa": 20.0, "b": 0.3}).parameters)
law = given.law
assert law.description() == {"law": "demiray", "mu": law.mu, "b": law.b}
assert "demiray" in LAW_NAMES
assert Fitting(laws=["demiray"]).laws == ["demiray"]
assert "| `demiray` | W = mu/(2 b)" in page(models.MODELS)
assert law.with_exponents(1.5).b == 1.5 * law.b

lam = np.linspace(1.0, 2.0, 20)
fit = fit_law(
    mean_curves([MaterialTest(kind, "s1", lam, nominal_stress(law, kind, lam)) for kind in LOAD_CASES]),
    "demiray",
)
assert_allclose(fit.parameters, [20.0, 0.3], rtol=1e-6)

path = Path(sys.argv[1]) / "law.json"
write_law(path, given)
assert_allclose(models.parameters_of(read_law(path).law), [20.0, 0.3], rtol=1e-9)

# One element of each law as the compiled loops see it: a further routine is found, and the others are still. Tangents at the
# rounding of quotients of close stretches, as in test_kernels.
law_of = {name: import_module(f"{models.__name__}.{name}") for name in ("hencky", "mixed")}
laws = [law, specimens.GEL, Gent(0.1, 20.0), MooneyRivlin(0.08, 0.02)]
laws += [law_of["hencky"].Hencky(0.1), law_of["mixed"].Mixed(0.05, 0.01, 0.02)]
rng = np.random.default_rng(11)
mesh = specimens.distorted(specimens.box(1), 0.2, rng, boundary=True)
u = mesh.X @ np.diag([0.3, 0.1, -0.3]) + 0.05 * rng.uniform(-1, 1, mesh.X.shape)
free = build_pattern(mesh.elements, np.zeros(8, bool))
node = mesh.elements[0]
for other in laws:
    mu, p = other.shear_modulus, -0.05 * other.shear_modulus
    values = np.empty(len(free.indices))
    found = Body(mesh, {"gel": other}, 1000.0, free).response(u, np.array([p]), values)
    twin = twins.element(mesh.X[node], u[node], p, other, 1000.0 * mu)
    assert_allclose(found.f_mixed[node], twin["f_mixed"], rtol=1e-10, atol=1e-12 * mu)
    assert_allclose(found.energy, twin["energy"], rtol=1e-10)
    dense, rows = np.zeros((24, 24)), np.repeat(np.arange(24), np.diff(free.indptr))
    dense[rows, free.indices] = dense[free.indices, rows] = values
    order = free.equation[node].ravel()
    assert_allclose(dense[np.ix_(order, order)], twin["tangent"], rtol=1e-9, atol=1e-9 * mu)
