import zlib

import csbrdf
import numpy as np
import pytest
from conftest import GOLDEN, NAMES


def crc(array):
    return f"{zlib.crc32(np.ascontiguousarray(array).tobytes()):08x}"


@pytest.fixture(params=NAMES)
def name(request):
    return request.param


@pytest.fixture
def brdf(name):
    return csbrdf.open(GOLDEN / name, pruned="coarse")


def test_there_are_golden_files(sums):
    assert len(NAMES) > 20 and set(NAMES) == set(sums)


def test_values_and_validity_are_as_they_were(brdf, name, sums):
    values, validity = brdf.decode(), brdf.validity()
    assert values.dtype == np.float32 and validity.dtype == bool
    assert values.shape == validity.shape == (len(brdf.channels), *brdf.shape)
    assert [crc(values), crc(validity)] == [sums[name][0], sums[name][2]]
    assert np.isfinite(values).all() and (values >= 0).all()


def test_exact_values_are_the_source_bit_by_bit(brdf, name, sums):
    if not brdf.lossless:
        with pytest.raises(csbrdf.Error, match="source values"):
            brdf.decode(exact=True)
        return
    exact = brdf.decode(exact=True)
    assert exact.dtype == np.float64 and exact.shape == brdf.decode().shape
    assert crc(exact) == sums[name][3]


def test_blocks_make_up_the_table(brdf):
    table, built = brdf.decode(), np.full((len(brdf.channels), *brdf.shape), np.nan, np.float32)
    for i in range(brdf.block_count):
        values, slices = brdf.block(i)
        assert values.dtype == np.float32 and np.isnan(built[slices]).all() and built[slices].shape == values.shape
        built[slices] = values
    assert built.tobytes() == table.tobytes()
    for i in (-1, brdf.block_count, 2**62):
        with pytest.raises(IndexError, match="no block"):
            brdf.block(i)


def test_origin_agrees_with_validity(brdf):
    origin, valid = brdf.origin(), brdf.validity()
    assert origin.dtype == np.uint8
    assert ((origin <= csbrdf.Origin.MEASURED) == valid).all() and origin.max() <= max(csbrdf.Origin)


def test_intact_files_verify(brdf):
    assert brdf.verify() == []


def test_what_the_independent_decoder_reads_is_the_same(independent):
    for name in ("dct-tiled.csbrdf", "dft-1d.csbrdf", "dct-4d-spectral.csbrdf"):
        data = (GOLDEN / name).read_bytes()
        brdf, file = csbrdf.Brdf(data, pruned="coarse"), independent.File(data, allow_pruned=True)
        values, _, valid = file.table()
        assert brdf.decode().tobytes() == values.astype("<f4").tobytes()
        assert brdf.validity().tobytes() == valid.astype(bool).tobytes()
        assert [(a.name, a.len) for a in brdf.axes] == [(a[0], a[2]) for a in file.axes][-len(brdf.axes):]
        assert brdf.block_count == len(file.blocks)


def test_axes_and_channels_say_what_the_numbers_mean():
    brdf = csbrdf.open(str(GOLDEN / "dct-opponent-mask.csbrdf"))
    assert [axis.name for axis in brdf.axes] == ["theta_h", "theta_d", "phi_d"]
    assert [axis.mapping for axis in brdf.axes] == ["square", "linear", "linear"]
    assert brdf.shape == tuple(axis.len for axis in brdf.axes)
    theta_h, theta_d, phi_d = brdf.axes
    assert (theta_h.start, theta_h.end, phi_d.end) == (0, np.pi / 2, np.pi)
    n = theta_h.len
    np.testing.assert_allclose(theta_h.edges(), np.pi / 2 * (np.arange(n + 1) / n) ** 2)
    np.testing.assert_allclose(theta_h.centers(), np.pi / 2 * ((np.arange(n) + 0.5) / n) ** 2)
    np.testing.assert_allclose(phi_d.centers(), np.pi * (np.arange(phi_d.len) + 0.5) / phi_d.len)
    assert [c.name for c in brdf.channels] == ["R", "G", "B"] and brdf.channels[0].wavelength is None
    assert brdf.axes[0] == csbrdf.open(GOLDEN / "dct-opponent-mask.csbrdf").axes[0] != brdf.axes[1]
    assert brdf.version[0] == 1 and "theta_h" in repr(brdf) and "square" in repr(brdf.axes[0])
    spectral = csbrdf.open(GOLDEN / "dct-4d-spectral.csbrdf")
    assert all(c.wavelength > 300 and c.scale > 0 for c in spectral.channels) and len(spectral.shape) == 4


def test_metadata_is_a_dict():
    found = [csbrdf.open(GOLDEN / name).metadata for name in NAMES]
    assert all(isinstance(metadata, dict) for metadata in found) and any(found)
