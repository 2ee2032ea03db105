"""Localization: estimates at a steady rate from readings of several sensors, in the order of their stamps.

In: readings as they arrive. Out: estimates at multiples of 1 / frequency, each as soon as every sensor has
sent a later reading. The same readings give the same estimates, to the bit, however fast they are played and
however the sensors' messages interleave.
"""

from __future__ import annotations

import heapq
from math import ceil, inf
from typing import Collection, Dict, List, Optional, Tuple

import numpy as np

from husky_highlevel_controller.estimation.filter_config import FilterConfig
from husky_highlevel_controller.estimation.planar_ekf import YAW_RATE, MotionEstimate, PlanarEkf
from husky_highlevel_controller.estimation.readings import MotionSensor, Mounting, Reading, ReadingError

# [s] the filter no longer waits for a silent sensor whose last reading is older than the newest reading by
# more than this
PATIENCE = 1.0
# [s] if the readings pause for longer than this, the estimates for the time of the pause are left out
MAX_PAUSE = 10.0
# [s] stamps closer than this count as equal, because a float of 64 bits has only seven decimals for seconds
# since 1970
SAME_TIME = 1e-6


class Localization:
    """The filter with its sensors."""

    def __init__(self, config: FilterConfig) -> None:
        """Make a filter without readings."""
        options = config.options
        self._frequency, self._predicts_to_now = options.frequency, options.predict_to_current_time
        # [s] If no measurement has come for this time, the estimates are predicted without measurements. If
        # the parameter `sensor_timeout` is not set, this is one period of the estimates.
        self._sensor_timeout = 1.0 / options.frequency
        if options.sensor_timeout is not None:
            self._sensor_timeout = options.sensor_timeout
        self._sensors = {
            name: MotionSensor(name, item, options.gravitational_acceleration)
            for name, item in config.inputs.items()
        }
        self._ekf = PlanarEkf(config.process_noise, config.initial_covariance)
        # heap of the readings that wait for other sensors: stamp, name of the sensor, reading, mounting
        self._waiting_readings: List[Tuple[float, str, Reading, Mounting]] = []
        self._first_stamp = inf  # [s] stamp of the first reading
        self._last_stamps: Dict[str, float] = {}  # [s] stamp of the last reading of each sensor
        self._pose_set_at = -inf  # [s] stamp of the last pose from `set_pose`
        self._last_sent_stamp = -inf  # [s] stamp of the last estimate that was returned
        self._next_period = 0  # time of the next estimate, as a number of periods from time 0

    def set_pose(self, stamp: float, pose: np.ndarray, covariance: np.ndarray) -> None:
        """Start again at a stamp [s], with a robot at rest; older readings are forgotten.

        `pose` is x, y and yaw in odom, (3,) [m, m, rad], and `covariance` is its covariance, (3, 3).
        """
        self._ekf.set_pose(stamp, pose, covariance)
        self._waiting_readings, self._pose_set_at = [], stamp
        self._next_period = ceil(stamp * self._frequency)
        for sensor in self._sensors.values():
            sensor.forget()

    def add(
        self, name: str, reading: Reading, mounting: Mounting, silent: Optional[Collection[str]] = None
    ) -> List[MotionEstimate]:
        """Take a reading of a sensor, and return the estimates that can be computed now.

        An estimate needs all readings before its time, so it waits until every sensor has sent a later one.

        Args:
            name: name of the sensor, such as odom0.
            reading: its reading.
            mounting: pose of the sensor, and pose of the frame in which it gives its poses.
            silent: names of the sensors from which the caller has received nothing for a long wall time; if
                None, the names of all sensors. The filter gives up such a sensor, and no longer waits for it,
                if its last reading is older than the newest reading of all sensors by more than PATIENCE.

        Raises:
            ReadingError: the reading is not later than the one before, or a used number is not finite.
        """
        last = self._last_stamps.get(name, -inf)
        if reading.stamp <= last:
            raise ReadingError(
                f"its stamp {reading.stamp:.6f} s is not later than the last stamp, {last:.6f} s"
            )
        reading = self._sensors[name].checked(reading)
        self._first_stamp = min(self._first_stamp, reading.stamp)
        self._last_stamps[name] = reading.stamp
        # a reading that is older than the pose of `set_pose` is ignored
        if reading.stamp > self._pose_set_at:
            heapq.heappush(self._waiting_readings, (reading.stamp, name, reading, mounting))
        # the filter waits for no further reading up to this time, so all readings up to then are processed
        horizon = self._horizon(self._sensors if silent is None else silent)
        due_estimates = []
        while self._waiting_readings and self._waiting_readings[0][0] <= horizon:
            due_estimates += self._process_oldest()
        # the last estimates up to `horizon`, and the one for the time `horizon` itself
        return due_estimates + self._estimates(horizon + SAME_TIME)

    def _process_oldest(self) -> List[MotionEstimate]:
        """Process the oldest reading that waits, and return the estimates for the time before this reading.

        Before the filter has started, there are no estimates.
        """
        stamp, name, reading, mounting = heapq.heappop(self._waiting_readings)
        # an estimate for the time of the reading itself comes later, because it must use the reading
        estimates = self._estimates(stamp - SAME_TIME)
        if not self._ekf.started:
            # Estimates are for multiples of the period. The first measurement starts the filter, so the first
            # estimate is for the first multiple that is not before this reading.
            self._next_period = ceil((stamp - SAME_TIME) * self._frequency)
        # [rad/s] yaw rate after the last measurement; 0 before the filter has started
        yaw_rate = float(self._ekf.estimate.state[YAW_RATE])
        for measurement in self._sensors[name].measurements(reading, mounting, yaw_rate):
            self._ekf.process(measurement)
        return estimates

    def _horizon(self, silent: Collection[str]) -> float:
        """Return the time up to which all readings have come from the sensors that are not given up [s].

        The filter does not wait for sensors that are given up. The sensors in `silent` have sent nothing for
        some wall time. Such a sensor is given up if its last reading is older than the newest reading of all
        sensors by more than PATIENCE.
        """
        oldest_allowed = max(self._last_stamps.values()) - PATIENCE
        awaited_stamps = []
        for name in self._sensors:
            # a sensor without a reading has been silent since the first reading of any sensor
            silent_since = self._last_stamps.get(name, self._first_stamp)
            if name in silent and silent_since < oldest_allowed:
                continue  # the sensor is given up
            # while the filter waits for the first reading of a sensor, nothing may be processed
            awaited_stamps.append(self._last_stamps.get(name, -inf))
        # the sensor with the newest reading is never given up, so there is at least one stamp
        return min(awaited_stamps)

    def _estimates(self, end: float) -> List[MotionEstimate]:
        """Return the estimates after the last one and before `end` [s]; none before the filter starts.

        All measurements before `end` must have been processed.
        """
        estimates: List[MotionEstimate] = []
        # after a longer pause of the readings, the estimates for the time of the pause are left out
        if end - self._ekf.estimate.stamp > MAX_PAUSE:
            self._next_period = max(self._next_period, ceil(end * self._frequency))
        while self._ekf.started and self._next_period / self._frequency < end:
            stamp = self._next_period / self._frequency
            self._next_period += 1
            has_no_recent_reading = stamp - self._ekf.estimate.stamp >= self._sensor_timeout
            if self._predicts_to_now or has_no_recent_reading:
                estimate = self._ekf.predicted(stamp)
            else:
                estimate = self._ekf.estimate
            # without a new measurement, the estimate is still the one that was sent before
            if estimate.stamp > self._last_sent_stamp:
                self._last_sent_stamp = estimate.stamp
                estimates.append(estimate)
        return estimates
