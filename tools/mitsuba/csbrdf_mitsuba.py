"""Measured BRDFs from .csbrdf files in Mitsuba 3.

    import mitsuba as mi
    mi.set_variant("llvm_ad_rgb")
    import csbrdf_mitsuba
    csbrdf_mitsuba.register()                # once for every variant that is set
    scene = mi.load_dict({..., "bsdf": {"type": "csbrdf", "filename": "chrome.csbrdf"}})

Parameters of the BSDF `csbrdf`:

filename    a .csbrdf file, or a MERL .binary table, whose missing entries then hold the mean of their measured neighbours; mode "texture"
mode        "texture": the whole table decoded into a Dr.Jit texture, looked up inside the kernels (default of JIT variants);
            "blocks": Brdf.eval of the Python package, which decodes what is asked for (default of scalar variants). In
            JIT variants blocks need evaluated loops and calls: `with csbrdf_mitsuba.evaluated(): mi.render(scene)`
sampling    a file as in `filename` that samples are drawn after instead (default: the material itself). Pictures of two versions
            of a material that share it differ by their values alone, not by their noise
pruned      "refuse": rendering fails where a .csbrdf file has lost a block that is needed, in mode "texture" loading does if it has
            lost any; "coarse": the block's mean stands for it (default "refuse"). Holds for `sampling` too
cosine      share of the samples drawn in proportion to the cosine, 0 to 1 (default 0.25, or 0 where the package draws)

The surface reflects on the side of its normal only; `twosided` around it makes it do so on both.

Samples: in mode "blocks" by Brdf.importance of the Python package, whose density integrates to one, for files over theta_h,
theta_d, phi_d and phi_h. Else, and where `sampling` is given: a half vector's elevation comes from the table's mean over
theta_d and phi_d per theta_h bin (or from some values of the file), within a bin uniform over its solid angle, its azimuth
is uniform, and the incident direction is mirrored at it. What falls below the horizon has weight zero and density zero:
that density integrates to less than one.
"""
import contextlib
import math

import csbrdf
import drjit as dr
import mitsuba as mi
import numpy as np

MERL_SCALE = np.array([1.0, 1.15, 1.66]) / 1500
MERL_AXES = ["theta_h", "theta_d", "phi_d"]
LARGEST = float(np.finfo(np.float32).max)
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


class Table:
    """A table over theta_h, theta_d, phi_d: float32 [theta_h, theta_d, phi_d, rgb] in 1/sr, and its axes."""

    def __init__(self, values, square, ends):
        self.values = values
        self.square = square  # theta_h: bins narrow near the normal
        self.ends = ends  # angle at the upper edge of each axis' last bin


def read_merl(path):
    """A MERL .binary table."""
    data = np.memmap(path, np.uint8, "r")
    shape = tuple(int(n) for n in data[:12].view("<i4"))
    if shape not in ((90, 90, 180), (90, 90, 360)) or data.size != 12 + 24 * math.prod(shape):
        raise ValueError(f"{path}: not a MERL table of 90 x 90 x 180 (or 360) bins")
    planes = data[12:].view("<f8").reshape(3, *shape)
    values = np.empty((*shape, 3), np.float32)
    for c, (plane, scale) in enumerate(zip(planes, MERL_SCALE)):
        measured = np.isfinite(plane) & (plane >= 0)
        values[..., c] = bridge(np.where(measured, plane * scale, 0), measured)
    return Table(values, True, (math.pi / 2, math.pi / 2, shape[2] * math.pi / 180))


def bridge(plane, measured):
    """Gives entries that were not measured the mean of their measured neighbours, and zero where they have none: all that
    interpolation can ever touch together with a measured one."""
    def around(a):
        for axis in range(3):
            pad = [(1, 1) if k == axis else (0, 0) for k in range(3)]
            a = np.pad(a, pad, mode="wrap" if axis == 2 else "constant")
            n = a.shape[axis] - 2
            a = sum(np.take(a, range(i, i + n), axis) for i in range(3))
        return a

    count = around(measured.astype(np.float32))
    mean = around(plane) / np.maximum(count, 1)
    return np.where(measured, plane, mean)


def read_csbrdf(brdf, path):
    """A .csbrdf file, whole."""
    axes = brdf.axes
    if [axis.name for axis in axes] != MERL_AXES or any(axis.start != 0 for axis in axes):
        names = [axis.name for axis in axes]
        raise ValueError(f"{path}: axes {names}; mode 'texture' knows {MERL_AXES} from 0 on, take mode 'blocks'")
    if any(axis.mapping != "linear" for axis in axes[1:]):
        raise ValueError(f"{path}: bins of theta_d or phi_d are not equal; take mode 'blocks'")
    values = np.ascontiguousarray(np.moveaxis(brdf.decode()[colours(brdf)], 0, -1))
    return Table(values, axes[0].mapping == "square", tuple(axis.end for axis in axes))


def colours(brdf):
    """The channels that are red, green and blue; one channel alone is grey."""
    names = [channel.name for channel in brdf.channels]
    if all(name in names for name in "RGB"):
        return [names.index(name) for name in "RGB"]
    if len(names) == 1:
        return [0, 0, 0]
    raise ValueError(f"channels {names[:4]}...: only R, G, B or a single channel can be rendered in an rgb variant")


def closes(span, of_difference):
    """Whether an azimuth's last bin is a neighbour of its first: a whole turn, or half a turn of phi_d by reciprocity."""
    return abs(span - 2 * math.pi) < 1e-4 or of_difference and abs(span - math.pi) < 1e-4


@contextlib.contextmanager
def evaluated():
    """Loops and calls are evaluated step by step instead of compiled into one kernel, as mode "blocks" needs."""
    with contextlib.ExitStack() as stack:
        for flag in (dr.JitFlag.SymbolicLoops, dr.JitFlag.SymbolicCalls, dr.JitFlag.SymbolicConditionals):
            stack.enter_context(dr.scoped_set_flag(flag, False))
        yield


class Lobe:
    """Mirrors the incident direction at half vectors: a share of the samples for each theta_h bin."""

    cosine = 0.25  # share of the samples that is better drawn by the cosine

    def __init__(self, weights, square, end):
        self.bins, self.square, self.end = len(weights), square, end
        self.distribution = mi.DiscreteDistribution(weights.astype(np.float32))

    def edge(self, i):
        t = i / self.bins
        return self.end * (t * t if self.square else t)

    def solid_angle(self, i):
        """Of bin i, by products: the cosines of neighbouring edges are the same number near the normal."""
        low, high = self.edge(i), self.edge(i + 1)
        return 4 * dr.pi * dr.sin((low + high) / 2) * dr.sin((high - low) / 2)

    def sample(self, wi, sample, active):
        i, u = self.distribution.sample_reuse(sample.x, active)
        # s = sin^2(theta / 2) is uniform over the sphere.
        s = dr.square(dr.sin(self.edge(mi.Float(i)) / 2)) + u * self.solid_angle(mi.Float(i)) / (4 * dr.pi)
        s = dr.minimum(s, 1.0)
        radius = 2 * dr.sqrt(s * (1 - s))
        sin_phi, cos_phi = dr.sincos(2 * dr.pi * sample.y)
        half = mi.Vector3f(radius * cos_phi, radius * sin_phi, 1 - 2 * s)
        return dr.normalize(2 * dr.dot(wi, half) * half - wi)

    def pdf(self, wi, wo, active):
        half = wi + wo
        theta = dr.atan2(dr.norm(mi.Vector2f(half.x, half.y)), half.z)
        t = dr.clip(theta / self.end, 0, 1)
        i = dr.minimum(dr.floor((dr.sqrt(t) if self.square else t) * self.bins), self.bins - 1)
        share = self.distribution.eval_pmf_normalized(mi.UInt32(i), active)
        # wi . half / |half| = |wi + wo| / 2
        return dr.select(theta <= self.end, share / self.solid_angle(i), 0) / dr.maximum(2 * dr.norm(half), 1e-20)


def lobe_of(table):
    """The lobe that suits a table: its luminance around the middle of theta_d's range, times cosine and solid angle."""
    bins, across = table.values.shape[:2]
    luminance = np.minimum(table.values[:, : max(1, 2 * across // 3)] @ LUMINANCE, 1e9).mean(axis=(1, 2))
    t = np.arange(bins + 1) / bins
    edges = table.ends[0] * (t * t if table.square else t)
    low, high = edges[:-1], edges[1:]
    weights = luminance * np.sin((low + high) / 2) * np.sin((high - low) / 2) * np.cos((low + high) / 2)
    # Never nothing: a material that reflects nothing there may do so elsewhere.
    return Lobe(weights + 1e-3 * weights.mean() + 1e-12, table.square, table.ends[0])


def generic_lobe(brdf):
    """For axes of other kinds: what the file gives for a few directions of incidence, by half vector."""
    bins, count = 90, 32
    random = np.random.default_rng(0)
    theta = (np.arange(bins) + 0.5) ** 2 / bins**2 * (math.pi / 2)
    weights = np.zeros(bins)
    for incidence in (0.1, 0.5, 0.9):
        wi = np.array([math.sin(incidence), 0, math.cos(incidence)])
        phi = random.uniform(0, 2 * math.pi, (bins, count))
        half = np.stack(np.broadcast_arrays(np.sin(theta)[:, None] * np.cos(phi), np.sin(theta)[:, None] * np.sin(phi),
                                            np.cos(theta)[:, None]), -1)
        wo = 2 * (half @ wi)[..., None] * half - wi
        weights += np.minimum(brdf.eval(wi, wo)[..., colours(brdf)] @ LUMINANCE, 1e9).mean(axis=1)
    edges = np.arange(bins + 1) ** 2 / bins**2 * (math.pi / 2)
    weights *= (np.cos(edges[:-1]) - np.cos(edges[1:])) * np.cos(theta)
    return Lobe(weights + 1e-3 * weights.mean() + 1e-12, True, math.pi / 2)


def half_difference(wi, wo):
    """theta_h, theta_d, phi_d (0 to 2 pi) of unit vectors, with the signs of the MERL reference reader."""
    total, difference = wi + wo, wi - wo
    along, across = dr.norm(total), dr.norm(difference)
    radius = dr.norm(mi.Vector2f(total.x, total.y))
    on_axis = radius < 1e-30
    cos_phi = dr.select(on_axis, 1, total.x / dr.select(on_axis, 1, radius))
    sin_phi = dr.select(on_axis, 0, total.y / dr.select(on_axis, 1, radius))
    scale = 1 / dr.maximum(along, 1e-30)
    sin_h, cos_h = radius * scale, total.z * scale
    tangent = cos_h * (cos_phi * difference.x + sin_phi * difference.y) - sin_h * difference.z
    phi = dr.atan2(cos_phi * difference.y - sin_phi * difference.x, tangent)
    return dr.atan2(radius, total.z), dr.atan2(across, along), dr.select(phi < 0, phi + 2 * dr.pi, phi)


class Texture:
    """The whole table in a texture; bin centres are texel centres."""

    def __init__(self, table):
        values = table.values
        self.table, self.closes = table, closes(table.ends[2], True)
        self.bins = values.shape[2]
        if self.closes:  # a bin more at both ends instead of a texture that wraps on all its axes
            values = np.concatenate([values[:, :, -1:], values, values[:, :, :1]], axis=2)
        tensor = mi.TensorXf(np.ascontiguousarray(values))
        self.texture = mi.Texture3f(tensor, filter_mode=dr.FilterMode.Linear, wrap_mode=dr.WrapMode.Clamp)

    def eval(self, light, view, active):
        theta_h, theta_d, phi_d = half_difference(light, view)
        end_h, end_d, end_p = self.table.ends
        t = dr.clip(theta_h / end_h, 0, 1)
        u = dr.sqrt(t) if self.table.square else t
        v = dr.clip(theta_d / end_d, 0, 1)
        if self.closes:
            turns = phi_d / end_p
            w = ((turns - dr.floor(turns)) * self.bins + 1) / (self.bins + 2)
        else:
            active &= phi_d <= end_p
            w = phi_d / end_p
        r, g, b = self.texture.eval(mi.Point3f(w, v, u), active)
        return dr.select(active, mi.Color3f(r, g, b), 0)


def outside(kind, function, active, *vectors):
    """What a function of arrays (n, ...) gives for active lanes, and zero elsewhere; called outside of the kernels."""
    if not dr.is_jit_v(mi.Float):
        return kind(function(*(np.array(v, np.float64) for v in vectors)).tolist()) if active else kind(0)
    if dr.flag(dr.JitFlag.SymbolicScope):
        raise RuntimeError("csbrdf: mode 'blocks' cannot be compiled into a kernel; render inside of "
                           "csbrdf_mitsuba.evaluated(), or take mode 'texture'")
    mask = np.asarray(mi.Bool(active).numpy())
    vectors = [np.asarray(v.numpy()).T for v in vectors]
    n = max(len(mask), *(len(v) for v in vectors))
    mask = np.broadcast_to(mask, n)
    found = function(*(np.broadcast_to(v, (n, v.shape[1]))[mask] for v in vectors))
    values = np.zeros((n, *found.shape[1:]), np.float32)
    values[mask] = found
    return kind(np.ascontiguousarray(values.T))


class Blocks:
    """Values from Brdf.eval, outside of the kernels."""

    def __init__(self, brdf):
        self.brdf, self.colours = brdf, colours(brdf)

    def eval(self, light, view, active):
        return outside(mi.Color3f, lambda *pair: self.brdf.eval(*pair)[..., self.colours], active, light, view)


class Importance:
    """Samples by Brdf.importance, outside of the kernels."""

    cosine = 0  # it has a share of its own

    def __init__(self, brdf):
        self.importance = brdf.importance()

    def sample(self, wi, sample, active):
        return outside(mi.Vector3f, lambda *given: self.importance.sample(*given)[0], active, wi, sample)

    def pdf(self, wi, wo, active):
        return outside(mi.Float, self.importance.pdf, active, wi, wo)


def open_source(filename, mode, pruned):
    """What gives the values of a file, and the lobe that suits them."""
    path = str(mi.file_resolver().resolve(filename))
    if mode not in ("texture", "blocks"):
        raise ValueError(f"csbrdf: mode is 'texture' or 'blocks', not '{mode}'")
    if pruned not in ("refuse", "coarse"):
        raise ValueError(f"csbrdf: pruned is 'refuse' or 'coarse', not '{pruned}'")
    if path.endswith(".binary"):
        if mode != "texture":
            raise ValueError("csbrdf: a .binary table has no blocks, take mode 'texture'")
        table = read_merl(path)
        return Texture(table), lobe_of(table)
    brdf = csbrdf.open(path, pruned=pruned)
    if mode == "texture":
        table = read_csbrdf(brdf, path)
        return Texture(table), lobe_of(table)
    names = [axis.name for axis in brdf.axes]
    known = "theta_h" in names and all(name in (*MERL_AXES, "phi_h") for name in names)
    return Blocks(brdf), Importance(brdf) if known else generic_lobe(brdf)


def make_class():
    """The BSDF's class, for the variant that is set."""

    class Csbrdf(mi.BSDF):
        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            if not mi.is_rgb or mi.is_polarized:
                raise ValueError(f"csbrdf: variant {mi.variant()} is not supported, only rgb variants are")
            jit = dr.is_jit_v(mi.Float)
            self.filename = props["filename"]
            usual = "texture" if jit or self.filename.endswith(".binary") else "blocks"
            self.mode = props.get("mode", usual)
            pruned = props.get("pruned", "refuse")
            self.source, self.lobe = open_source(self.filename, self.mode, pruned)
            if "sampling" in props:
                self.lobe = open_source(props["sampling"], "texture", pruned)[1]
            self.cosine = float(props.get("cosine", self.lobe.cosine))
            if not 0 <= self.cosine <= 1:
                raise ValueError(f"csbrdf: cosine is {self.cosine}, must be within 0 and 1")
            # Isotropic or not: a table may have its azimuths.
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            self.m_components = [flags]
            self.m_flags = flags

        def values(self, ctx, si, wo, active):
            """f times the cosine."""
            # Light arrives along what is sampled, unless particles are traced.
            light, view = (wo, si.wi) if ctx.mode == mi.TransportMode.Radiance else (si.wi, wo)
            return self.source.eval(light, view, active) * dr.maximum(mi.Frame3f.cos_theta(wo), 0)

        def density(self, si, wo, active):
            lobe = self.lobe.pdf(si.wi, wo, active)
            pdf = self.cosine * mi.Frame3f.cos_theta(wo) / dr.pi + (1 - self.cosine) * lobe
            return dr.select(active, pdf, 0)

        @staticmethod
        def above(si, wo, active):
            return active & (mi.Frame3f.cos_theta(si.wi) > 0) & (mi.Frame3f.cos_theta(wo) > 0)

        def sample(self, ctx, si, sample1, sample2, active=True):
            bs = dr.zeros(mi.BSDFSample3f)
            if not ctx.is_enabled(mi.BSDFFlags.GlossyReflection):
                return bs, mi.Color3f(0)
            by_cosine = sample1 < self.cosine
            spread = mi.warp.square_to_cosine_hemisphere(sample2)
            drawn = self.lobe.sample(si.wi, sample2, active)
            wo = dr.select(by_cosine, spread, drawn)
            active = self.above(si, wo, active)
            bs.wo = wo
            bs.pdf = self.density(si, wo, active)
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            bs.sampled_component = mi.UInt32(0)
            active &= bs.pdf > 0
            value = self.values(ctx, si, wo, active) / dr.select(active, bs.pdf, 1)
            # The largest values that a file can hold would overflow.
            return bs, dr.select(active, dr.minimum(value, LARGEST), 0)

        def eval(self, ctx, si, wo, active=True):
            if not ctx.is_enabled(mi.BSDFFlags.GlossyReflection):
                return mi.Color3f(0)
            return self.values(ctx, si, wo, self.above(si, wo, active))

        def pdf(self, ctx, si, wo, active=True):
            if not ctx.is_enabled(mi.BSDFFlags.GlossyReflection):
                return mi.Float(0)
            return self.density(si, wo, self.above(si, wo, active))

        def eval_pdf(self, ctx, si, wo, active=True):
            if not ctx.is_enabled(mi.BSDFFlags.GlossyReflection):
                return mi.Color3f(0), mi.Float(0)
            active = self.above(si, wo, active)
            return self.values(ctx, si, wo, active), self.density(si, wo, active)

        def traverse(self, callback):
            pass

        def parameters_changed(self, keys):
            pass

        def to_string(self):
            return f"Csbrdf[filename = {self.filename}, mode = {self.mode}, cosine = {self.cosine}]"

    return Csbrdf


def register():
    """Makes the BSDF `csbrdf` known to the variant that is set."""
    made = make_class()
    mi.register_bsdf("csbrdf", lambda props: made(props))
