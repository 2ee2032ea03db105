"""Polar coordinates of the nearest return of a scan."""


def nearest(scan):
    distance, beam = min((r, i) for i, r in enumerate(scan.ranges) if r >= scan.range_min)
    return distance, scan.angle_min + beam * scan.angle_increment
