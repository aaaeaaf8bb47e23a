"""Directions to values from the decoded table, in NumPy: angles as of the MERL reference reader, linear interpolation."""
import numpy as np

TAU = 2 * np.pi


def unit(w):
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


def rotate(v, axis, angle):
    """Rotation about a unit axis, with a minus where the reader is called with one."""
    angle = angle[:, None]
    along = (v @ axis)[:, None] * axis
    return v * np.cos(angle) + np.cross(axis, v) * np.sin(angle) + along * (1 - np.cos(angle))


def angles(wi, wo):
    """Elevations and azimuths by axis name."""
    wi, wo = unit(wi), unit(wo)
    half = unit(wi + wo)
    found = {}
    for name, w in (("h", half), ("i", wi), ("o", wo)):
        found["theta_" + name] = np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2])
        found["phi_" + name] = np.arctan2(w[:, 1], w[:, 0]) % TAU
    turned = rotate(wi, np.array([0.0, 0, 1]), -found["phi_h"])
    difference = rotate(turned, np.array([0.0, 1, 0]), -found["theta_h"])
    found["theta_d"] = np.arctan2(np.hypot(difference[:, 0], difference[:, 1]), difference[:, 2])
    found["phi_d"] = np.arctan2(difference[:, 1], difference[:, 0]) % TAU
    return found


def coordinate(axis, angle):
    t = np.clip((angle - axis.start) / (axis.end - axis.start), 0, 1)
    return (np.sqrt(t) if axis.mapping == "square" else t) * axis.len


def evaluate(brdf, wi, wo, lookup):
    """Values (n, channels) in float64, and which of them do not hang on a rounding: an undefined or unstable azimuth, a
    bin's edge where the nearest is asked for."""
    table = brdf.decode().astype(np.float64)
    found = angles(wi, wo)
    names = [axis.name for axis in brdf.axes]
    sure = np.ones(len(wi), bool)
    # An azimuth says little where its elevation is small.
    for name in names:
        if name.startswith("phi"):
            sure &= found["theta" + name[3:]] > 1e-5
    values = np.zeros((len(wi), len(table)))
    corners = [(np.zeros(len(wi), int), np.ones(len(wi)))]
    for axis in brdf.axes:
        angle, span = found[axis.name], axis.end - axis.start
        closes = False
        if axis.name.startswith("phi"):
            other = {"phi_i": "phi_o", "phi_o": "phi_i"}.get(axis.name)
            if other and other not in names:
                angle = (angle - found[other]) % TAU
                if abs(span - np.pi) < 1e-5:
                    angle = np.minimum(angle, TAU - angle)
            closes = abs(span - TAU) < 1e-5 or axis.name == "phi_d" and abs(span - np.pi) < 1e-5
            if closes:
                angle = axis.start + (angle - axis.start) % span
        u = coordinate(axis, angle)
        if lookup == "nearest":
            sure &= abs(u - np.round(u)) > 1e-6
            places = [(np.minimum(u.astype(int), axis.len - 1), np.ones(len(wi)))]
        else:
            low = np.floor(u - 0.5).astype(int)
            weight = u - 0.5 - low
            wrap = (lambda i: i % axis.len) if closes else (lambda i: np.clip(i, 0, axis.len - 1))
            places = [(wrap(low), 1 - weight), (wrap(low + 1), weight)]
        corners = [(i * axis.len + place, share * w) for i, share in corners for place, w in places]
    for index, share in corners:
        values += (table.reshape(len(table), -1)[:, index] * share).T
    return values, sure
