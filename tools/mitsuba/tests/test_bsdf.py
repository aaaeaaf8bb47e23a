"""The plugin in the variant that VARIANT names (llvm_ad_rgb)."""
import math
import os

import mitsuba as mi
import numpy as np
import pytest
from conftest import GOLDEN

mi.set_variant(os.environ.get("VARIANT", "llvm_ad_rgb"))

import csbrdf  # noqa: E402
import csbrdf_mitsuba  # noqa: E402
import drjit as dr  # noqa: E402

csbrdf_mitsuba.register()
JIT = dr.is_jit_v(mi.Float)
jit = pytest.mark.skipif(not JIT, reason="a test of wavefronts")

SHINY = str(GOLDEN / "dct-grazing-zeros.csbrdf")
SATIN = str(GOLDEN / "dct-dependent.csbrdf")
ANISOTROPIC = str(GOLDEN / "dft-4d-coarse-extremes.csbrdf")
PRUNED, WHOLE = (str(GOLDEN / f"{name}.csbrdf") for name in ("final-pruned", "final-profile"))
SPECTRAL = str(GOLDEN / "dct-4d-spectral.csbrdf")


def load(filename, **more):
    return mi.load_dict({"type": "csbrdf", "filename": filename, **more})


def towards(theta, phi=0.3):
    return [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)]


def seen_from(theta, n=1):
    si = dr.zeros(mi.SurfaceInteraction3f, n) if JIT else mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(towards(theta))
    return si


def random_vectors(n, seed, low=0.0):
    random = np.random.default_rng(seed)
    z, phi = random.uniform(low, 1, n), random.uniform(0, 2 * math.pi, n)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], -1).astype(np.float32)


def pairs(n, low=0.0):
    """Directions, among them mirrored and equal ones."""
    wi, wo = random_vectors(n, 1, low), random_vectors(n, 2, low)
    wo[: n // 8] = wi[: n // 8] * [-1, -1, 1] + 1e-3 * random_vectors(n // 8, 3)
    wo[n // 8: n // 4] = wi[n // 8: n // 4] + 1e-3 * random_vectors(n // 8, 4)
    return wi, wo / np.linalg.norm(wo, axis=1, keepdims=True)


def evaluate(bsdf, wi, wo, context=None):
    context = context or mi.BSDFContext()
    if JIT:
        si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
        si.wi = mi.Vector3f(np.ascontiguousarray(wi.T))
        return bsdf.eval(context, si, mi.Vector3f(np.ascontiguousarray(wo.T))).numpy().T
    values = []
    for i, o in zip(wi, wo):
        si = mi.SurfaceInteraction3f()
        si.wi = mi.Vector3f(i.tolist())
        values.append(np.array(bsdf.eval(context, si, mi.Vector3f(o.tolist()))))
    return np.array(values)


@pytest.mark.parametrize("mode", ["texture", "blocks"])
@pytest.mark.parametrize("name", ["dct-grazing-zeros", "dct-dependent", "dct-opponent-mask", "dct-tiled"])
def test_values_are_those_of_the_package_times_the_cosine(name, mode):
    path = str(GOLDEN / f"{name}.csbrdf")
    wi, wo = pairs(20000 if JIT else 400, low=0.01)
    got = evaluate(load(path, mode=mode), wi, wo)
    expected = csbrdf.open(path).eval(wo, wi) * wo[:, 2:]
    near = np.abs(got - expected) <= 2e-3 * expected + 1e-5 * np.median(expected)
    # Where a lobe is steep, single precision of the angles is more than that.
    assert near.mean() > 0.999 and np.isfinite(got).all()


@jit
def test_light_and_view_change_places_with_the_transport():
    wi, wo = pairs(1000)
    for path, mode in [(ANISOTROPIC, "blocks"), (SATIN, "texture")]:
        bsdf, file = load(path, mode=mode), csbrdf.open(path)
        colours = csbrdf_mitsuba.colours(file)
        for transport, expected in [(mi.TransportMode.Radiance, file.eval(wo, wi)), (mi.TransportMode.Importance, file.eval(wi, wo))]:
            got = evaluate(bsdf, wi, wo, mi.BSDFContext(transport))
            np.testing.assert_allclose(got / wo[:, 2:], expected[:, colours], rtol=0.05, atol=1e-3 * np.median(expected))


def test_nothing_is_reflected_below_the_horizon():
    for mode in ("texture", "blocks"):
        bsdf = load(SATIN, mode=mode)
        up, down = np.array([[0, 0, 1.0]], np.float32), np.array([[0.6, 0, -0.8]], np.float32)
        for wi, wo in [(up, down), (down, up), (down, down)]:
            assert (evaluate(bsdf, wi, wo) == 0).all()
        assert (evaluate(bsdf, up, up) > 0).all()


@jit
@pytest.mark.parametrize("path, mode", [(SHINY, "texture"), (SATIN, "texture"), (SHINY, "blocks"), (SATIN, "blocks"),
                                        (ANISOTROPIC, "blocks"), (SPECTRAL, "blocks")])
@pytest.mark.parametrize("theta", [0.0, 0.7, 1.4])
def test_samples_have_the_density_that_pdf_says(path, mode, theta, monkeypatch):
    from mitsuba.chi2 import ChiSquareTest

    if path == SPECTRAL:  # over the angles of incidence and exitance; three of its channels for red, green and blue
        monkeypatch.setattr(csbrdf_mitsuba, "colours", lambda brdf: [15, 9, 3])
    bsdf, context = load(path, mode=mode), mi.BSDFContext()
    frame = mi.Frame3f(mi.Vector3f(towards(theta, 0.3 + math.pi)))

    class AroundTheMirror:
        """Azimuth about the mirror direction, and the square root of the angle to it, in turns: fine where the lobe is."""

        def bounds(self):
            return mi.ScalarBoundingBox2f([-math.pi, 0], [math.pi, 1])

        def aspect(self):
            return 2

        def map_forward(self, p):
            sin, cos = dr.sincos(dr.pi * dr.square(p.y))
            sin_phi, cos_phi = dr.sincos(p.x)
            return frame.to_world(mi.Vector3f(sin * cos_phi, sin * sin_phi, cos))

        def map_backward(self, w):
            w = frame.to_local(w)
            angle = dr.atan2(dr.norm(mi.Vector2f(w.x, w.y)), w.z)
            return mi.Vector2f(dr.atan2(w.y, w.x), dr.sqrt(angle / dr.pi))

    domain = AroundTheMirror()

    def sample(u):
        si = seen_from(theta, dr.width(u))
        bs, weight = bsdf.sample(context, si, u[0], mi.Point2f(u[1], u[2]))
        valid = bs.pdf > 0
        assert dr.all(dr.select(valid, True, dr.all(weight == 0)))
        same = dr.abs(bsdf.pdf(context, si, bs.wo) - bs.pdf) <= 1e-4 * bs.pdf
        value = bsdf.eval(context, si, bs.wo)
        agree = (dr.abs(weight * bs.pdf - value) <= 1e-4 * value + 1e-20) | (weight > 1e37) | ~valid
        assert dr.all(same | ~valid) and dr.all(agree, axis=None) and dr.all(dr.isfinite(weight), axis=None)
        return dr.select(valid, bs.wo, mi.Vector3f(0, 0, 1)), dr.select(valid, mi.Float(1), mi.Float(0))

    def pdf(w):
        t = domain.map_backward(w).y
        return bsdf.pdf(context, seen_from(theta, dr.width(w)), w) * dr.sin(dr.pi * t * t) * 2 * dr.pi * t

    test = ChiSquareTest(domain, sample, pdf, sample_dim=3, sample_count=400_000, res=41, ires=24)
    assert test.run(0.01, 12), test.messages
    assert test.histogram_sum[0] > (0.9999 if mode == "blocks" and path != SPECTRAL else 0.4)


@jit
@pytest.mark.parametrize("path", [SHINY, SATIN])
@pytest.mark.parametrize("mode", ["texture", "blocks"])
@pytest.mark.parametrize("theta", [0.1, 0.8, 1.3])
def test_a_white_furnace_gives_the_albedo(path, mode, theta):
    """The mean weight of samples is the albedo, by quadrature with the Python package."""
    n = 400_000
    random = mi.PCG32(size=n)
    si = seen_from(theta, n)
    u = mi.Point2f(random.next_float32(), random.next_float32())
    _, weight = load(path, mode=mode).sample(mi.BSDFContext(), si, random.next_float32(), u)
    weight = weight.numpy()
    assert np.isfinite(weight).all() and (weight >= 0).all()
    wo = random_vectors(1 << 20, 7)
    # Over uniform directions; stratified in z.
    z = (np.arange(len(wo)) + 0.5) / len(wo)
    wo = np.stack([*(wo[:, :2].T / np.linalg.norm(wo[:, :2], axis=1) * np.sqrt(1 - z * z)), z], -1)
    albedo = (csbrdf.open(path).eval(wo, towards(theta)) * wo[:, 2:]).mean(axis=0) * 2 * math.pi
    error = weight.std(axis=1) / math.sqrt(n)
    assert (np.abs(weight.mean(axis=1) - albedo) < 5 * error + 0.01 * albedo).all()


def test_a_sphere_in_a_white_furnace_is_no_brighter_than_its_albedo():
    scene = mi.load_dict({
        "type": "scene", "integrator": {"type": "direct"}, "light": {"type": "constant"},
        "sphere": {"type": "sphere", "bsdf": {"type": "csbrdf", "filename": SATIN}},
        "sensor": {"type": "perspective", "fov": 30, "to_world": mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
                   "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}}},
    })
    image = np.array(mi.render(scene, spp=64 if JIT else 16))[..., :3]
    wo = random_vectors(1 << 18, 5).astype(np.float64)
    albedo = (csbrdf.open(SATIN).eval(wo, [0, 0, 1]) * wo[:, 2:]).mean(axis=0) * 2 * math.pi
    assert np.isfinite(image).all()
    np.testing.assert_allclose(image[7:9, 7:9].mean(axis=(0, 1)), albedo, rtol=0.15)


@jit
def test_blocks_render_what_the_texture_renders():
    def render(mode):
        scene = mi.load_dict({
            "type": "scene", "integrator": {"type": "path", "max_depth": 3}, "light": {"type": "constant"},
            "a": {"type": "sphere", "bsdf": {"type": "csbrdf", "filename": SATIN, "mode": mode, "sampling": SATIN}},
            "b": {"type": "sphere", "center": [1.5, 1, -1], "bsdf": {"type": "diffuse"}},
            "sensor": {"type": "perspective", "to_world": mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
                       "film": {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"}}},
        })
        return np.array(mi.render(scene, spp=4))

    with csbrdf_mitsuba.evaluated():
        blocks = render("blocks")
    np.testing.assert_allclose(blocks, render("texture"), rtol=1e-3, atol=1e-4)


@jit
def test_blocks_cannot_be_compiled_into_a_kernel():
    bsdf, wi = load(SATIN, mode="blocks"), mi.Vector3f(0, 0, 1)
    context, si = mi.BSDFContext(), seen_from(0.1)
    for call in (lambda: bsdf.eval(context, si, wi), lambda: bsdf.pdf(context, si, wi),
                 lambda: bsdf.sample(context, si, mi.Float(0.5), mi.Point2f(0.5))):
        with dr.scoped_set_flag(dr.JitFlag.SymbolicScope, True), pytest.raises(RuntimeError, match="evaluated()"):
            call()


def test_blocks_are_drawn_after_the_package():
    bsdf, importance, context = load(SHINY, mode="blocks"), csbrdf.open(SHINY).importance(), mi.BSDFContext()
    for theta, u in [(0.0, [0.2, 0.3]), (0.7, [0.9, 0.1]), (1.5, [0.5, 0.6]), (1.6, [0.5, 0.6])]:
        bs, weight = bsdf.sample(context, seen_from(theta), mi.Float(0.0), mi.Point2f(u))
        got = [np.array(x).reshape(-1) for x in (bs.wo, bs.pdf, bsdf.pdf(context, seen_from(theta), bs.wo))]
        wo, pdf = importance.sample(np.float32(towards(theta)), np.float32(u))
        for a, b in zip(got, (wo, pdf, pdf)):
            np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-6)
        assert (np.array(weight) == 0).all() if theta > 1.58 else (np.array(weight) > 0).all()


def test_merl_tables_are_read_in_1_per_sr(tmp_path):
    random = np.random.default_rng(0)
    raw = random.uniform(100, 200, (3, 90, 90, 180))
    raw[:, 40:50, 80:, 20:30] = -1
    raw[0, 3, 3, 3] = np.nan
    path = tmp_path / "a.binary"
    with open(path, "wb") as f:
        f.write(np.array([90, 90, 180], "<i4").tobytes() + raw.astype("<f8").tobytes())
    table = csbrdf_mitsuba.read_merl(path)
    assert table.values.shape == (90, 90, 180, 3)
    for c, scale in enumerate([1 / 1500, 1.15 / 1500, 1.66 / 1500]):
        np.testing.assert_allclose(table.values[5, 6, 7, c], raw[c, 5, 6, 7] * scale, rtol=1e-6)
    around = raw[0, 2:5, 2:5, 2:5]
    np.testing.assert_allclose(table.values[3, 3, 3, 0], np.nanmean(around) / 1500, rtol=1e-5)
    # Next to measured ones: their mean; further in: nothing.
    assert 100 / 1500 < table.values[45, 80, 25, 0] < 200 / 1500 and table.values[45, 85, 25, 0] == 0
    assert "texture" in str(load(str(path)))
    with pytest.raises(Exception, match="no blocks"):
        load(str(path), mode="blocks")
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(Exception, match="not a MERL table"):
        load(str(path))


def test_a_constant_table_is_a_diffuse_surface(tmp_path):
    path = tmp_path / "a.binary"
    with open(path, "wb") as f:
        f.write(np.array([90, 90, 180], "<i4").tobytes())
        for scale in csbrdf_mitsuba.MERL_SCALE:
            f.write(np.full(90 * 90 * 180, 0.5 / math.pi / scale).tobytes())
    diffuse = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}})
    wi, wo = pairs(1000 if JIT else 200)
    np.testing.assert_allclose(evaluate(load(str(path)), wi, wo), evaluate(diffuse, wi, wo), rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("mode", ["texture", "blocks"])
def test_pruned_blocks_are_coarse_if_that_is_asked_for(mode):
    wi, wo = pairs(4000 if JIT else 200, low=0.01)
    got = evaluate(load(PRUNED, mode=mode, pruned="coarse", sampling=PRUNED), wi, wo)
    expected = csbrdf.open(PRUNED, pruned="coarse").eval(wo, wi) * wo[:, 2:]
    near = np.abs(got - expected) <= 2e-3 * expected + 1e-5 * np.median(expected)
    assert near.mean() > 0.999 and np.isfinite(got).all()
    if mode == "blocks":
        bsdf = load(PRUNED, mode=mode)
        # Some of these directions look at what was left out, none does in the whole file.
        with pytest.raises(Exception, match="was pruned"):
            evaluate(bsdf, wi, wo)
        assert np.isfinite(evaluate(load(WHOLE, mode=mode), wi, wo)).all()


def test_what_cannot_be_rendered_says_why():
    for path, more, what in [
        (SATIN, {"mode": "cubic"}, "'texture' or 'blocks'"),
        (SATIN, {"cosine": 1.5}, "within 0 and 1"),
        (SATIN, {"pruned": "mean"}, "'refuse' or 'coarse'"),
        (PRUNED, {"mode": "texture"}, "was pruned"),
        (SATIN, {"sampling": PRUNED}, "was pruned"),
        (SPECTRAL, {"mode": "blocks"}, "R, G, B"),
        (ANISOTROPIC, {"mode": "texture"}, "take mode 'blocks'"),
        (str(GOLDEN / "missing.csbrdf"), {}, "No such file"),
        (str(GOLDEN / "hashes.txt"), {}, "not a csbrdf file"),
        (str(GOLDEN / "dft-1d.csbrdf"), {"mode": "blocks"}, "do not say how directions map"),
    ]:
        with pytest.raises(Exception, match=what):
            load(path, **more)
