#!/usr/bin/env python3
"""/front/scan is what the Noetic Husky's SICK would send in the single-pillar world."""

from math import hypot, inf

from harness import RosTest, run
from sensor_msgs.msg import LaserScan

NEAR_SIDE = hypot(20.0 - 0.3370, 5.0) - 0.2  # [m], from the lidar to the pillar's surface


class ScanMatchesWorld(RosTest):
    from_the_start = True

    def test_a_scan_looks_like_the_huskys(self):
        scans = self.remember("front/scan", LaserScan)
        self.wait_until(lambda: scans, "there is a scan")
        scan = scans[0]
        self.assertEqual(scan.header.frame_id, "front_laser")
        self.assertEqual((len(scan.ranges), len(scan.intensities)), (720, 720))
        self.assertAlmostEqual(scan.angle_min, -2.35619, places=5)
        self.assertAlmostEqual(scan.angle_max, 2.35619, places=5)
        self.assertAlmostEqual(scan.angle_increment, 2 * 2.35619 / 719, places=7)
        self.assertEqual((scan.time_increment, scan.scan_time), (0.0, 0.0))
        self.assertAlmostEqual(scan.range_min, 0.1, places=6)
        self.assertAlmostEqual(scan.range_max, 30.0, places=5)

    def test_only_the_pillar_is_seen_at_its_distance_and_on_the_side_of_an_upside_down_lidar(self):
        scans = self.remember("front/scan", LaserScan)
        self.wait_until(lambda: len(scans) > 50, "there are 50 scans")
        for scan in scans:
            hits = [i for i, r in enumerate(scan.ranges) if r != inf]
            self.assertIn(hits, ([321, 322, 323], [320, 321, 322, 323], [321, 322]))
            self.assertAlmostEqual(scan.ranges[322], NEAR_SIDE, delta=0.015)
        middle = [scan.ranges[322] for scan in scans]
        self.assertGreater(len(set(middle)), 25, "there is noise")


if __name__ == "__main__":
    run(ScanMatchesWorld)
