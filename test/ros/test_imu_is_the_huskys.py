#!/usr/bin/env python3
"""The IMU is the Husky's: 9.8 upwards at rest, noise, covariances."""

from statistics import mean, pstdev

from driver import Driver
from harness import RosTest, run
from sensor_msgs.msg import Imu


class ImuIsTheHuskys(RosTest):
    from_the_start = True

    def test_at_rest_it_feels_9_8_upwards_with_the_husky_s_noise(self):
        messages = self.remember("imu/data", Imu)
        self.wait_until(lambda: len(messages) > 300, "there are 300 samples")
        still = messages[50:]
        for vector, expected in (("linear_acceleration", (0.0, 0.0, 9.8)), ("angular_velocity", (0.0,) * 3)):
            for axis, value in zip("xyz", expected):
                numbers = [getattr(getattr(msg, vector), axis) for msg in still]
                self.assertAlmostEqual(mean(numbers), value, delta=0.003, msg=f"{vector}.{axis}")
                self.assertAlmostEqual(pstdev(numbers), 0.005, delta=0.002, msg=f"{vector}.{axis}")
        self.assertAlmostEqual(still[-1].orientation.w, 1.0, places=3)

        roll_and_pitch = (0.005 / 9.8) ** 2
        for i, value in enumerate((roll_and_pitch, 0, 0, 0, roll_and_pitch, 0, 0, 0, 0)):
            self.assertAlmostEqual(still[-1].orientation_covariance[i], value, places=12)
        self.assertEqual(set(still[-1].angular_velocity_covariance), {0.0}, "unknown")
        self.assertEqual(set(still[-1].linear_acceleration_covariance), {0.0}, "unknown")

    def test_left_is_positive(self):
        messages = self.remember("imu/data", Imu)
        driver = Driver()
        self.addCleanup(driver.stop)
        driver.drive(0.0, 0.5)
        self.wait_until(lambda: messages and messages[-1].angular_velocity.z > 0.4, "it turns left", 10.0)
        self.wait_until(lambda: messages[-1].orientation.z > 0.1, "its heading grows", 10.0)


if __name__ == "__main__":
    run(ImuIsTheHuskys)
