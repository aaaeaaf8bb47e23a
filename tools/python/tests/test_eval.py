import concurrent.futures
import multiprocessing
import os

import csbrdf
import numpy as np
import pytest
import reference
from conftest import GOLDEN, NAMES

MERL_LIKE = "dct-dependent.csbrdf"
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def brdf():
    return csbrdf.open(GOLDEN / MERL_LIKE)


def directional(brdf):
    try:
        brdf.eval(UP, UP)
    except csbrdf.Error:
        return False
    return True


def random_directions(n, seed):
    random = np.random.default_rng(seed)
    z, phi = random.uniform(0, 1, n), random.uniform(0, 2 * np.pi, n)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)


DIRECTIONAL = [name for name in NAMES if directional(csbrdf.open(GOLDEN / name))]


def test_most_golden_files_have_axes_that_are_directions():
    assert len(DIRECTIONAL) > 12
    assert any(len(csbrdf.open(GOLDEN / name).shape) == 4 for name in DIRECTIONAL)


@pytest.mark.parametrize("lookup", ["linear", "nearest"])
@pytest.mark.parametrize("name", DIRECTIONAL)
def test_values_are_the_interpolated_table(name, lookup):
    brdf = csbrdf.open(GOLDEN / name, lookup=lookup, pruned="coarse")
    wi, wo = random_directions(3000, 1), random_directions(3000, 2)
    # Retro-reflection and the mirror direction: the ends of theta_d and theta_h, and both sides of where phi_d closes.
    wo[:200] = wi[:200]
    wo[200:400] = wi[200:400] * [-1, -1, 1]
    wo[400:600] += 1e-3 * random_directions(200, 3)
    wo[600:800] = wi[600:800] + 1e-6
    wo[800:1000, :2] = 1.3 * wi[800:1000, :2]
    expected, sure = reference.evaluate(brdf, wi, wo, lookup)
    assert sure.mean() > 0.7
    got = brdf.eval(wi, wo)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got[sure], expected[sure], rtol=2e-5, atol=1e-7 * expected.max())


def test_cache_size_and_source_do_not_change_bits():
    data = (GOLDEN / MERL_LIKE).read_bytes()
    wi, wo = random_directions(2000, 5), random_directions(2000, 6)
    expected = csbrdf.open(GOLDEN / MERL_LIKE).eval(wi, wo)
    for other in (csbrdf.Brdf(data, 0), csbrdf.Brdf(data=bytearray(data), cache_bytes=1 << 40)):
        assert other.eval(wi, wo).tobytes() == expected.tobytes()


def test_shapes_broadcast(brdf):
    one = brdf.eval([0.3, 0.0, 0.9], (-0.5, 0.1, 0.8))
    assert one.shape == (3,) and (one > 0).all()
    wi, wo = random_directions(7, 1), random_directions(20, 2)
    for a, b in [
        (wi, UP), (UP, wo), (wi[:, None], wo), (wi[None], wi[:, None]), (wi[:1], wo), (wi[:0], UP), (UP[None], UP),
        (wo.reshape(4, 1, 5, 3), random_directions(6, 3).reshape(6, 1, 3)), (wi, wi[::-1]), (np.asfortranarray(wi), UP),
        (np.broadcast_to(UP, (2, 2, 3)), UP), (wi[:0], wo[:1]), (wi[:0, None], wo),
    ]:
        shape = np.broadcast_shapes(np.shape(a)[:-1], np.shape(b)[:-1])
        flat_a, flat_b = (np.broadcast_to(x, (*shape, 3)).reshape(-1, 3) for x in (a, b))
        expected = np.array([brdf.eval(i, o) for i, o in zip(flat_a, flat_b)], np.float32).reshape(*shape, 3)
        got = brdf.eval(a, b)
        assert got.shape == (*shape, 3) and got.tobytes() == expected.tobytes()


def test_types_are_read_as_what_they_are(brdf):
    wi, wo = random_directions(30, 1), random_directions(30, 2)
    exact = brdf.eval(wi, wo)
    single = wi.astype(np.float32), wo.astype(np.float32)
    assert brdf.eval(*single).tobytes() == brdf.eval(*(w.astype(np.float64) for w in single)).tobytes()
    assert brdf.eval(wi, single[1]).tobytes() == brdf.eval(wi, single[1].astype(np.float64)).tobytes()
    assert brdf.eval(wi.astype(">f8"), wo).tobytes() == exact.tobytes()
    packed = np.zeros(30, np.dtype([("flag", "u1"), ("w", "f8", 3)]))
    packed["w"] = wi
    assert not packed["w"].flags.aligned
    assert brdf.eval(packed["w"], wo.tolist()).tobytes() == exact.tobytes()
    assert (brdf.eval([0, 0, 1], np.array([0, 0, 1], np.uint8)) == brdf.eval(UP, UP)).all()
    wi.flags.writeable = False
    assert brdf.eval(wi, wo).tobytes() == exact.tobytes()


def test_directions_that_are_none_give_zero(brdf):
    below, nan, inf = [0, 0.6, -0.8], [np.nan, 0, 1], [0, 0, np.inf]
    bad = np.array([below, nan, inf, [0, 0, 0], [0, 0, -np.inf], [-0.0, 0, -1e-300]])
    assert (brdf.eval(bad, UP) == 0).all() and (brdf.eval(UP, bad) == 0).all()
    graze = np.array([[1, 0, 0], [-1, 0, 1e-9], [1e-200, 0, 1e-200], [1e300, 1e300, 1e300], [5e-324, 0, 0]])
    values = brdf.eval(graze[:, None], graze)
    assert np.isfinite(values).all() and (values >= 0).all()


def test_large_batches_are_the_same_bits_as_small_ones(brdf):
    n = 150_000
    wi, wo = random_directions(n, 8).astype(np.float32), random_directions(n, 9)
    whole = brdf.eval(wi, wo)
    parts = np.concatenate([brdf.eval(wi[i:i + 100], wo[i:i + 100]) for i in range(0, n, 100)])
    assert whole.tobytes() == parts.tobytes()


def test_threads_share_a_file():
    brdf = csbrdf.open(GOLDEN / MERL_LIKE, cache_bytes=1)
    wi, wo = random_directions(600, 8), random_directions(600, 9)
    values, table = brdf.eval(wi, wo).tobytes(), brdf.decode().tobytes()

    def work(i):
        return (brdf.eval(wi, wo).tobytes() == values) if i % 3 else (brdf.decode().tobytes() == table)

    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        assert all(pool.map(work, range(30)))


def child(queue, brdf, wi, wo):
    queue.put((brdf.eval(wi, wo).tobytes(), brdf.decode().tobytes()))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_child_has_threads_of_its_own(brdf):
    wi, wo = random_directions(5000, 8), random_directions(5000, 9)
    expected = brdf.eval(wi, wo).tobytes(), brdf.decode().tobytes()
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    process = context.Process(target=child, args=(queue, brdf, wi, wo))
    process.start()
    assert queue.get(timeout=60) == expected
    process.join(60)
    assert process.exitcode == 0


def test_a_file_may_be_replaced_while_it_is_open(tmp_path):
    path, other = tmp_path / "a.csbrdf", tmp_path / "b.csbrdf"
    path.write_bytes((GOLDEN / MERL_LIKE).read_bytes())
    brdf = csbrdf.open(path)
    expected = csbrdf.open(GOLDEN / MERL_LIKE).decode()
    other.write_bytes(b"something else")
    os.replace(other, path)
    assert brdf.decode().tobytes() == expected.tobytes()
