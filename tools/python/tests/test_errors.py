import csbrdf
import numpy as np
import pytest
from conftest import GOLDEN, NAMES

UP = [0, 0, 1]


@pytest.fixture(scope="module")
def brdf():
    return csbrdf.open(GOLDEN / "dct-opponent-mask.csbrdf")


def test_files_that_the_system_refuses_are_os_errors(tmp_path):
    missing = tmp_path / "missing.csbrdf"
    with pytest.raises(FileNotFoundError) as e:
        csbrdf.open(missing)
    assert e.value.errno == 2 and e.value.filename == str(missing) and "No such file" in e.value.strerror
    with pytest.raises(OSError):
        csbrdf.open(tmp_path)
    with pytest.raises((OSError, ValueError)):
        csbrdf.open("nul\0byte")


def test_files_that_are_something_else_are_refused(tmp_path):
    assert issubclass(csbrdf.Error, ValueError) and repr(csbrdf.Error) == "<class 'csbrdf.Error'>"
    for data, what in [(b"", "is empty"), (b"hello, world" * 9, "not a csbrdf file"), (bytes(100), "not a csbrdf file")]:
        path = tmp_path / "x.csbrdf"
        path.write_bytes(data)
        with pytest.raises(csbrdf.Error, match=what) as e:
            csbrdf.open(path)
        assert str(path) in str(e.value)
        with pytest.raises(csbrdf.Error, match=what):
            csbrdf.Brdf(data)
    newer = bytearray((GOLDEN / NAMES[0]).read_bytes())
    newer[8] = 9
    with pytest.raises(csbrdf.Error, match="version 9"):
        csbrdf.Brdf(newer)


@pytest.mark.parametrize("name", ["dct-tiled.csbrdf", "dct-lossless.csbrdf"])
def test_truncated_files_are_refused_wherever_they_end(tmp_path, name):
    data = (GOLDEN / name).read_bytes()
    path = tmp_path / "x.csbrdf"
    for length in [*range(0, 200), *range(200, len(data), 61), len(data) - 1]:
        with pytest.raises(csbrdf.Error):
            csbrdf.Brdf(data[:length])
        if length % 50 == 0:
            path.write_bytes(data[:length])
            with pytest.raises(csbrdf.Error):
                csbrdf.open(path)


def test_damage_is_an_error_and_nothing_else():
    directions = np.random.default_rng(1).normal(size=(50, 3))
    directions[:, 2] = abs(directions[:, 2])
    for name in ("dct-grazing-zeros.csbrdf", "dft-sampled-horizon.csbrdf"):
        data = (GOLDEN / name).read_bytes()
        for at in range(0, len(data), 23):
            damaged = bytearray(data)
            damaged[at] ^= 1 << at % 8
            try:
                brdf = csbrdf.Brdf(damaged)
            except csbrdf.Error:
                continue
            assert brdf.verify()
            for call in (
                brdf.decode, brdf.validity, brdf.origin, lambda: brdf.metadata, lambda: brdf.eval(directions, UP),
                *(lambda i=i: brdf.block(i) for i in range(brdf.block_count)),
            ):
                try:
                    call()
                except csbrdf.Error as e:
                    assert "offset" in str(e)


@pytest.mark.parametrize("wi, wo, what", [
    ([0, 0], UP, r"wi has shape \(2,\); its last axis must hold x, y, z"),
    (UP, np.zeros((5, 4)), r"wo has shape \(5, 4\)"),
    (1.0, UP, r"wi has shape \(\)"),
    (UP, [], r"wo has shape \(0,\)"),
    (np.zeros((4, 3)), np.zeros((5, 3)), r"do not broadcast against each other: \(4,\) and \(5,\)"),
    (np.zeros((0, 3)), np.zeros((5, 3)), "do not broadcast"),
])
def test_shapes_that_do_not_fit_say_so(brdf, wi, wo, what):
    with pytest.raises(ValueError, match=what):
        brdf.eval(wi, wo)


@pytest.mark.filterwarnings("ignore:Creating an ndarray from ragged")
@pytest.mark.parametrize("bad", [np.array([0, 0, 1j]), ["a", "b", "c"], None, [None, 0, 1], [[0, 0, 1], [0, 1]], object(), {}])
def test_what_are_no_numbers_is_refused(brdf, bad):
    with pytest.raises((TypeError, ValueError)):
        brdf.eval(bad, UP)


def test_a_result_that_memory_cannot_hold_is_no_crash(brdf):
    many = np.zeros((1 << 23, 3), np.float32)
    with pytest.raises((MemoryError, ValueError)):
        brdf.eval(many[:, None], many)


def test_arguments_are_checked(brdf):
    data = (GOLDEN / NAMES[0]).read_bytes()
    with pytest.raises(ValueError, match="lookup is"):
        csbrdf.open(GOLDEN / NAMES[0], lookup="cubic")
    with pytest.raises(ValueError, match="lookup is"):
        csbrdf.Brdf(data, lookup="")
    with pytest.raises(ValueError, match="pruned is"):
        csbrdf.Brdf(data, pruned="")
    for call in (lambda: csbrdf.Brdf("text"), lambda: csbrdf.Brdf(None), lambda: csbrdf.open(3.5), lambda: brdf.block("a")):
        with pytest.raises(TypeError):
            call()
    for call in (lambda: csbrdf.Brdf(data, cache_bytes=-1), lambda: brdf.block(1 << 200)):
        with pytest.raises(OverflowError):
            call()
    with pytest.raises(AttributeError):
        brdf.shape = (1,)


def test_axes_that_are_no_directions_decode_but_do_not_evaluate():
    brdf = csbrdf.open(GOLDEN / "dft-1d.csbrdf")
    assert brdf.decode().ndim == 2
    with pytest.raises(csbrdf.Error, match="do not say how directions map"):
        brdf.eval(UP, UP)


def test_pruned_blocks_are_refused_unless_allowed():
    with pytest.raises(csbrdf.Error, match="block 1 was pruned"):
        csbrdf.open(GOLDEN / "pruned.csbrdf").decode()
    coarse = csbrdf.open(GOLDEN / "pruned.csbrdf", pruned="coarse")
    values, slices = coarse.block(1)
    assert (values > 0).any() and not coarse.validity()[slices].any()


def test_larger_tables_than_the_limit_are_refused():
    path = GOLDEN / "dct-opponent-mask.csbrdf"
    values = csbrdf.open(path).decode().size
    for opened in (csbrdf.open(path, limit=values), csbrdf.Brdf(path.read_bytes(), limit=values)):
        assert opened.decode().size == values
    small = csbrdf.open(path, limit=values - 1)
    for ask in (small.decode, small.validity):
        with pytest.raises(csbrdf.Error, match=f"above the limit of {values - 1}"):
            ask()
    assert small.block(0)[0].size > 0
    with pytest.raises((OverflowError, TypeError)):
        csbrdf.open(path, limit=-1)
