import concurrent.futures
import multiprocessing
import os

import csbrdf
import numpy as np
import pytest
from conftest import GOLDEN
from test_eval import random_directions

GLOSSY = "dct-dependent-profile.csbrdf"
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def importance():
    return csbrdf.open(GOLDEN / GLOSSY).importance()


def elevated(theta, phi=0.3):
    return np.stack(np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), -1)


def random_numbers(n, seed):
    return np.random.default_rng(seed).uniform(size=(n, 2))


def by_half_vector(wi, n):
    """Directions whose half vectors with wi are a fine grid, fine towards the normal, and the solid angle of each; those
    that are below the horizon have none."""
    theta = (np.arange(n) + 0.5) ** 2 / n**2 * np.pi / 2
    width = (2 * np.arange(n) + 1) / n**2 * np.pi / 2
    phi = (np.arange(n) + 0.5) / n * 2 * np.pi
    half = elevated(theta[:, None], phi)
    cos = half @ wi
    wo = 2 * cos[..., None] * half - wi
    area = np.where((cos > 0) & (wo[..., 2] > 0), 4 * cos * (np.sin(theta) * width)[:, None] * 2 * np.pi / n, 0)
    return wo, area


@pytest.mark.parametrize("name", [GLOSSY, "dct-dependent.csbrdf", "dct-grazing-zeros.csbrdf", "dct-4d-spectral.csbrdf"])
@pytest.mark.parametrize("theta", [0.0, 0.6, 1.2, 1.5])
def test_densities_integrate_to_1(name, theta):
    importance, wi = csbrdf.open(GOLDEN / name).importance(), elevated(theta)
    wo, area = by_half_vector(wi, 1000)
    assert abs((importance.pdf(wi, wo) * area).sum() - 1) < 5e-3


@pytest.mark.parametrize("name", [GLOSSY, "dct-dependent.csbrdf"])
def test_samples_weigh_the_albedo(name):
    brdf = csbrdf.open(GOLDEN / name)
    importance = brdf.importance()
    for theta in (0.2, 0.9):
        wi = elevated(theta)
        wo, area = by_half_vector(wi, 1000)
        albedo = (brdf.eval(wi, wo) * (wo[..., 2] * area)[..., None]).sum(axis=(0, 1))
        wo, pdf = importance.sample(wi, random_numbers(100_000, 1))
        weight = brdf.eval(wi, wo) * wo[:, 2:] / pdf[:, None]
        error = weight.std(axis=0) / np.sqrt(len(wo))
        assert (abs(weight.mean(axis=0) - albedo) < 5 * error + 5e-3 * albedo).all()


def test_samples_have_the_density_that_pdf_says(importance):
    wi = random_directions(20_000, 1)
    wo, pdf = importance.sample(wi, random_numbers(20_000, 2))
    assert wo.dtype == pdf.dtype == np.float64 and wo.shape == (20_000, 3) and pdf.shape == (20_000,)
    assert (wo[:, 2] > 0).all() and (pdf > 0).all() and np.isfinite(pdf).all()
    np.testing.assert_allclose(np.linalg.norm(wo, axis=1), 1, rtol=1e-12)
    # A few are at an edge between parts of other densities, where a last digit decides.
    assert np.isclose(importance.pdf(wi, wo), pdf, rtol=1e-9, atol=0).mean() > 0.999


def test_a_lobe_is_followed_where_the_angles_allow():
    wi, u = elevated(0.5), random_numbers(4000, 3)
    shiny, _ = csbrdf.open(GOLDEN / "dct-grazing-zeros.csbrdf").importance().sample(wi, u)
    by_cosine, pdf = csbrdf.open(GOLDEN / "dct-4d-spectral.csbrdf").importance().sample(wi, u)
    near = [(wo @ (wi * [-1, -1, 1]) > np.cos(0.2)).mean() for wo in (shiny, by_cosine)]
    assert near[0] > 2 * near[1]
    np.testing.assert_allclose(pdf, by_cosine[:, 2] / np.pi, rtol=1e-12)


def test_rows_without_a_sample_are_zero(importance):
    below, level, nan, inf = [0, 0.6, -0.8], [1, 0, 0], [np.nan, 0, 1], [0, 0, np.inf]
    bad = np.array([below, level, nan, inf, [0, 0, 0], [0, 0, -np.inf], [-0.0, 0, -1e-300]])
    wo, pdf = importance.sample(np.concatenate([bad, [UP]]), [0.4, 0.5])
    assert (wo[:-1] == 0).all() and (pdf[:-1] == 0).all() and wo[-1, 2] > 0 and pdf[-1] > 0
    assert (importance.pdf(bad, UP) == 0).all() and (importance.pdf(UP, bad) == 0).all()
    extreme = np.array([[-0.9, 0, 1e-9], [1e-200, 0, 1e-200], [1e300, 1e300, 1e300], [0, 0, 5e-324]])
    assert np.isfinite(importance.pdf(extreme[:, None], extreme)).all()
    wo, pdf = importance.sample(extreme[:, None], [[0, 0], [1 - 2**-53, 0.5], [0.5, 1 - 2**-53]])
    assert (wo[..., 2] > 0).all() and (pdf > 0).all() and np.isfinite(pdf).all()


def test_numbers_outside_go_to_the_nearer_end(importance):
    outside = [[-1, 0.3], [1, 0.3], [np.nan, 0.3], [np.inf, 0.3], [0.3, 7]]
    end = 1 - 2**-53
    inside = [[0, 0.3], [end, 0.3], [0, 0.3], [end, 0.3], [0.3, end]]
    for got, expected in zip(importance.sample(elevated(0.5), outside), importance.sample(elevated(0.5), inside)):
        assert got.tobytes() == expected.tobytes()


def test_shapes_broadcast(importance):
    wo, pdf = importance.sample([0.3, 0.0, 0.9], (0.2, 0.7))
    assert wo.shape == (3,) and pdf.shape == () and importance.pdf(UP, wo).shape == ()
    wi, u, wo = random_directions(6, 1), random_numbers(20, 2), random_directions(20, 3)
    for a, b in [
        (wi, u[0]), (UP, u), (wi[:, None], u), (wi[:1], u), (wi[:0], u[0]), (wi[:0, None], u), (wi, u[:6][::-1]),
        (wi.reshape(6, 1, 3), u.reshape(4, 1, 5, 2)), (np.asfortranarray(wi), np.asfortranarray(u[:6])),
    ]:
        shape = np.broadcast_shapes(np.shape(a)[:-1], np.shape(b)[:-1])
        flat_a, flat_b = np.broadcast_to(a, (*shape, 3)).reshape(-1, 3), np.broadcast_to(b, (*shape, 2)).reshape(-1, 2)
        single = [importance.sample(i, j) for i, j in zip(flat_a, flat_b)]
        got_wo, got_pdf = importance.sample(a, b)
        assert got_wo.shape == (*shape, 3) and got_pdf.shape == shape
        assert got_wo.tobytes() == b"".join(wo.tobytes() for wo, _ in single)
        assert got_pdf.tobytes() == b"".join(pdf.tobytes() for _, pdf in single)
    for a, b in [(wi, UP), (UP, wo), (wi[:, None], wo), (wi[:0, None], wo), (wi.reshape(6, 1, 3), wo.reshape(4, 1, 5, 3))]:
        shape = np.broadcast_shapes(np.shape(a)[:-1], np.shape(b)[:-1])
        flat = (np.broadcast_to(w, (*shape, 3)).reshape(-1, 3) for w in (a, b))
        got = importance.pdf(a, b)
        assert got.dtype == np.float64 and got.shape == shape
        assert got.tobytes() == b"".join(importance.pdf(i, o).tobytes() for i, o in zip(*flat))


def test_types_are_read_as_what_they_are(importance):
    wi, u = random_directions(30, 1).astype(np.float32), random_numbers(30, 2).astype(np.float32)
    wo, pdf = importance.sample(wi, u)
    for a, b in [(wi.astype(np.float64), u), (wi, u.astype(">f8")), (wi.tolist(), u.tolist())]:
        assert [x.tobytes() for x in importance.sample(a, b)] == [wo.tobytes(), pdf.tobytes()]
    expected = importance.pdf(wi, wo.astype(np.float32))
    assert importance.pdf(wi.astype(np.float64), wo.astype(np.float32).astype(np.float64)).tobytes() == expected.tobytes()


def test_large_batches_are_the_same_bits_as_small_ones(importance):
    n = 150_000
    wi, u = random_directions(n, 8).astype(np.float32), random_numbers(n, 9)
    wo, pdf = importance.sample(wi, u)
    parts = [importance.sample(wi[i:i + 100], u[i:i + 100]) for i in range(0, n, 100)]
    assert wo.tobytes() == b"".join(w.tobytes() for w, _ in parts)
    assert pdf.tobytes() == b"".join(p.tobytes() for _, p in parts)
    whole = importance.pdf(wi, wo)
    assert whole.tobytes() == b"".join(importance.pdf(wi[i:i + 100], wo[i:i + 100]).tobytes() for i in range(0, n, 100))


def test_threads_share_one(importance):
    wi, u = random_directions(2000, 8), random_numbers(2000, 9)
    wo, pdf = importance.sample(wi, u)
    expected = wo.tobytes(), pdf.tobytes(), importance.pdf(wi, wo).tobytes()

    def work(_):
        got_wo, got_pdf = importance.sample(wi, u)
        return (got_wo.tobytes(), got_pdf.tobytes(), importance.pdf(wi, wo).tobytes()) == expected

    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        assert all(pool.map(work, range(30)))


def child(queue, importance, wi, u):
    queue.put([a.tobytes() for a in importance.sample(wi, u)])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_child_draws_too(importance):
    wi, u = random_directions(5000, 8), random_numbers(5000, 9)
    expected = [a.tobytes() for a in importance.sample(wi, u)]
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    process = context.Process(target=child, args=(queue, importance, wi, u))
    process.start()
    assert queue.get(timeout=60) == expected
    process.join(60)
    assert process.exitcode == 0


def test_it_needs_its_file_no_more(importance):
    alone = csbrdf.Brdf((GOLDEN / GLOSSY).read_bytes()).importance()
    wi, u = random_directions(100, 1), random_numbers(100, 2)
    assert alone.sample(wi, u)[0].tobytes() == importance.sample(wi, u)[0].tobytes()


@pytest.mark.parametrize("wi, u, what", [
    ([0, 0], [0, 0], r"wi has shape \(2,\); its last axis must hold x, y, z"),
    (UP, np.zeros((5, 3)), r"u has shape \(5, 3\); its last axis must hold 2 numbers"),
    (UP, 0.5, r"u has shape \(\); its last axis must hold 2 numbers"),
    (np.zeros((4, 3)), np.zeros((5, 2)), r"wi and u do not broadcast against each other: \(4,\) and \(5,\)"),
])
def test_shapes_that_do_not_fit_say_so(importance, wi, u, what):
    with pytest.raises(ValueError, match=what):
        importance.sample(wi, u)


def test_arguments_are_checked(importance):
    with pytest.raises(ValueError, match=r"wo has shape \(4,\)"):
        importance.pdf(UP, np.zeros(4))
    with pytest.raises(ValueError, match=r"wi and wo do not broadcast against each other: \(4,\) and \(5,\)"):
        importance.pdf(np.zeros((4, 3)), np.zeros((5, 3)))
    for bad in (np.array([0, 1j]), ["a", "b"], None, object()):
        with pytest.raises((TypeError, ValueError)):
            importance.sample(UP, bad)
    with pytest.raises(TypeError):
        csbrdf.Importance()
    many = np.zeros((1 << 23, 3), np.float32)
    with pytest.raises((MemoryError, ValueError)):
        importance.pdf(many[:, None], many)


def test_files_that_cannot_be_drawn_from_say_why():
    with pytest.raises(csbrdf.Error, match="do not say how directions map"):
        csbrdf.open(GOLDEN / "dft-1d.csbrdf").importance()
    data = bytearray((GOLDEN / GLOSSY).read_bytes())
    refused = 0
    for at in range(0, len(data), 97):
        data[at] ^= 1
        try:
            brdf = csbrdf.Brdf(data)
        except csbrdf.Error:
            brdf = None
        try:
            if brdf:
                brdf.importance()
        except csbrdf.Error as e:
            assert "offset" in str(e)
            refused += 1
        data[at] ^= 1
    assert refused > 10


def test_pruned_blocks_are_left_out():
    wi, u = random_directions(1000, 1), random_numbers(1000, 2)
    pdfs = [csbrdf.open(GOLDEN / "pruned.csbrdf", pruned=p).importance().sample(wi, u)[1] for p in ("refuse", "coarse")]
    assert all((pdf > 0).all() for pdf in pdfs) and (pdfs[0] != pdfs[1]).any()
