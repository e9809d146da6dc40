#!/usr/bin/env python3
"""Positions on the WGS 84 ellipsoid to 50 digits, for tests/measure_geodesy.rs.

Writes geodesy50.json beside itself: sites with an eye and flat ground, and posts of a grid around each. A post's position
less the eye's, Earth-centred axes, metres, stands there with 50 significant digits of which at least 40 are right.

Run: pip install mpmath && python3 tests/numerics/geodesy50.py
"""

import json
import pathlib

from mpmath import mp, mpf, cos, pi, sin, sqrt, nstr

mp.dps = 60

A = mpf(6378137)
F = 1 / mpf("298.257223563")
E2 = F * (2 - F)

# name, partition, posts per degree, eye (latitude, longitude in degrees; height above the ground in metres), height of
# the ground above the ellipsoid in metres. Every number is a binary fraction or is read as the nearest double.
SITES = [
    ("equator", "geographic", 1200, (0.0001, 10.0002, 0.3), 0.0),
    ("dead sea", "geographic", 3600, (31.50011, 35.47503, 0.3), -430.0),
    ("high plain", "geographic", 3600, (-16.20007, -68.12501, 0.3), 4000.0),
    ("highest ground", "geographic", 3600, (27.98812, 86.92503, 0.3), 8848.0),
    ("45 north below", "geographic", 1200, (44.999, 7.00003, 100.0), 250.0),
    ("45 north above", "geographic", 1200, (45.001, 7.00003, 100.0), 250.0),
    ("45 south", "geographic", 1200, (-45.0, 170.50002, 100.0), 250.0),
    ("date line from the west", "geographic", 1200, (-19.5, 179.99997, 30.0), 5.0),
    ("date line from the east", "geographic", 1200, (-19.5, -179.99997, 30.0), 5.0),
    ("70 north below", "geographic", 1200, (69.9, 25.00002, 300.0), 1000.0),
    ("70 south below", "geographic", 1200, (-69.9, 25.00002, 300.0), 1000.0),
    ("18 000 m", "geographic", 1200, (46.50002, 8.00003, 18000.0), 500.0),
    ("70 north above", "north", 1200, (70.1, 25.00002, 300.0), 1000.0),
    ("near the north pole", "north", 1200, (89.999, -77.0, 0.3), 0.0),
    ("north pole", "north", 1200, (90.0, 0.0, 0.3), 0.0),
    ("70 south above", "south", 1200, (-70.1, -120.00002, 300.0), 2800.0),
    ("near the south pole", "south", 1200, (-89.999, 13.0, 0.3), 2800.0),
    ("south pole", "south", 1200, (-90.0, 0.0, 18000.0), 2800.0),
]

# Posts east and north of the one nearest to the eye, in posts of the finest level.
OFFSETS = [
    (0, 0), (1, 0), (0, -1), (2, 3), (-7, 5), (40, -36), (-52, 48), (120, 100), (-160, 64), (256, -192), (-512, 448), (1024, 896),
]


def rad(degrees):
    return mpf(degrees) * pi / 180


def normal(partition, lon, lat):
    """The ellipsoid's unit normal at a grid longitude and latitude, radians."""
    c = cos(lat)
    if partition == "geographic":
        return (c * cos(lon), c * sin(lon), sin(lat))
    if partition == "north":
        return (c * sin(lon), sin(lat), c * cos(lon))
    return (c * sin(lon), -sin(lat), -c * cos(lon))


def ecef(n, height):
    """The point at a height above the ellipsoid where its unit normal is n."""
    radius = A / sqrt(1 - E2 * n[2] ** 2)
    return ((radius + height) * n[0], (radius + height) * n[1], (radius * (1 - E2) + height) * n[2])


def grid_position(partition, lon_deg, lat_deg):
    """Grid longitude and latitude in degrees of a geodetic position, for finding the post nearest to it."""
    if partition == "geographic":
        return lon_deg, lat_deg
    x, y, z = (float(v) for v in normal("geographic", rad(lon_deg), rad(lat_deg)))
    from math import atan2, degrees, hypot

    if partition == "south":
        y, z = -y, -z
    return degrees(atan2(x, z)), degrees(atan2(y, hypot(x, z)))


def site(name, partition, per_degree, eye, ground):
    lat, lon, above = eye
    eye_height = mpf(ground) + mpf(above)
    eye_at = ecef(normal("geographic", rad(lon), rad(lat)), mpf(float(eye_height)))
    grid_lon, grid_lat = grid_position(partition, lon, lat)
    i0, j0 = round(grid_lon * per_degree), round(grid_lat * per_degree)
    posts = []
    for di, dj in OFFSETS:
        # Even posts from 64 on and multiples of 64 from 512 on, so that coarse levels have them too.
        step = 1
        far = max(abs(di), abs(dj))
        while step * 50 < far:
            step *= 2
        i, j = (i0 + di) // step * step, (j0 + dj) // step * step
        n = normal(partition, rad(mpf(i) / per_degree), rad(mpf(j) / per_degree))
        p = ecef(n, mpf(ground))
        posts.append({"i": i, "j": j, "from_eye_m": [nstr(a - b, 50) for a, b in zip(p, eye_at)]})
    return {
        "name": name,
        "partition": partition,
        "posts_per_degree": per_degree,
        "eye_deg_deg_m": [lat, lon, float(eye_height)],
        "ground_m": ground,
        "posts": posts,
    }


if __name__ == "__main__":
    table = {"made_by": "geodesy50.py, mpmath", "sites": [site(*s) for s in SITES]}
    target = pathlib.Path(__file__).with_name("geodesy50.json")
    target.write_text(json.dumps(table, indent=1) + "\n")
    print(sum(len(s["posts"]) for s in table["sites"]), "positions")
