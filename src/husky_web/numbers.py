"""Numbers of the run as the page shows them: time, speeds, errors, rates, and the pillar's position."""

from __future__ import annotations

from math import inf, nan
from typing import Dict, Optional

from husky_highlevel_controller.datatypes import Twist2D, Vector3
from husky_highlevel_controller.geometry import transform_point
from husky_highlevel_controller.ros import conversions
from husky_web.plots import Curve
from husky_web.scene import Scene
from husky_web.topics import Topics

# [s] wall time without odometry after which the page reports that the robot is not responding
NO_NEWS_TIME = 2.0
RATE_WINDOW = 3.0  # [s] the rate of the scans and the real-time factor are measured over this time
EXPIRY = 3.0  # [s] simulated time after which a number without a new message is not shown any more
UNKNOWN = Twist2D(nan, nan)


class Numbers:
    """The newest numbers; each sample is also added to its curve."""

    def __init__(self, curves: Dict[str, Curve]) -> None:
        """Begin without numbers; `curves` has the names of `plots.CHARTS`."""
        self._curves = curves
        self.forget()

    def forget(self) -> None:
        """Forget all numbers, because they would be old when the next page opens."""
        # curve of the number of scans so far over simulated time [s]; the rate of this curve is the number of
        # scans per second
        self.scans = Curve(series=1, window=RATE_WINDOW)
        # curve of simulated time [s] over wall time [s]; the rate of this curve is the real-time factor
        self.clock = Curve(series=1, window=RATE_WINDOW)
        self._heard_at = -inf  # [s] wall time of the last odometry
        self._commanded = self._measured = UNKNOWN  # newest commanded, and newest measured motion
        self.time: Optional[float] = None  # [s] simulated time of the newest odometry
        self.distance: Optional[float] = None  # [m] remaining distance to the stop point
        self.speed: Optional[float] = None  # [m/s] measured forward speed
        self.bearing: Optional[float] = None  # [rad] bearing of the pillar
        self.pillar: Optional[Vector3] = None  # [m] position of the pillar in the fixed frame
        # [s] simulated time at which the last distance, and the last position of the pillar, have come
        self._error_at, self._pillar_at = -inf, -inf

    def take(self, topics: Topics, scene: Scene, now: float) -> None:
        """Take in new messages of the topics; `now` is wall time [s].

        The scene has the TF frames, and the stamp of its newest scan.
        """
        has_odometry = self._take_motion(topics, now)
        self._take_controllers_numbers(topics, scene)
        self._forget_old_numbers()
        if has_odometry and self.time is not None:
            self._curves["speed"].add(self.time, self._commanded.linear, self._measured.linear)
            self._curves["turning"].add(self.time, self._commanded.angular, self._measured.angular)
        if self.time is not None:
            self.clock.add(now, self.time)
        if topics.scan_count:  # otherwise no scan has come yet, so there is no stamp of a scan
            # Time of this sample [s]. The time of odometry goes on if the lidar ends, so the rate of the
            # scans then goes down to 0. Without odometry, the stamp of the newest scan is the only known
            # time.
            scan_time = scene.scan_stamp if self.time is None else self.time
            self.scans.add(scan_time, topics.scan_count)

    def _take_motion(self, topics: Topics, now: float) -> bool:
        """Take in the measured and the commanded motion; return whether a measured motion has come."""
        # the page subscribes to only one of these topics: to the true poses if a simulator publishes them
        odometry = topics.take("truth") or topics.take("odometry")
        if odometry is not None:
            self._heard_at = now
            self._measured = conversions.twist_from_msg(odometry.twist.twist)
            self.time, self.speed = odometry.header.stamp.to_sec(), self._measured.linear
        command = topics.take("command")
        if command is not None:
            self._commanded = conversions.twist_from_msg(command.twist)
        return odometry is not None

    def _take_controllers_numbers(self, topics: Topics, scene: Scene) -> None:
        """Take in the controller's distance to its stop point, and the pillar's bearing and position."""
        error = topics.take("error")
        if error is not None:
            # the controller's message has the remaining distance [m] in x and the bearing [rad] in y
            self.distance, self.bearing = error.vector.x, error.vector.y
            self._error_at = self._simulated_now
            self._curves["distance"].add(error.header.stamp.to_sec(), error.vector.x)
            self._curves["bearing"].add(error.header.stamp.to_sec(), error.vector.y)
        pillar = topics.take("pillar")
        if pillar is not None:
            frame = scene.frames.pose(pillar.header.frame_id, scene.fixed_frame)
            point = (pillar.point.x, pillar.point.y, pillar.point.z)
            self.pillar = None if frame is None else transform_point(frame, point)
            self._pillar_at = self._simulated_now

    def _forget_old_numbers(self) -> None:
        """Remove the controller's numbers that are older than EXPIRY, because the controller has ended.

        After a restart of the simulator, simulated time begins at 0 again. A number from before the restart
        then has a later time than the present one, so it is removed, too.
        """
        if not 0.0 <= self._simulated_now - self._error_at <= EXPIRY:
            self.distance = self.bearing = None
        if not 0.0 <= self._simulated_now - self._pillar_at <= EXPIRY:
            self.pillar = None

    @property
    def _simulated_now(self) -> float:
        """Simulated time of the newest odometry [s]; 0 before the first odometry."""
        return self.time or 0.0

    def expect_silence(self, now: float) -> None:
        """Let the time without odometry begin at the wall time `now` [s], because the world is paused."""
        self._heard_at = now

    def is_silent(self, now: float) -> bool:
        """Return whether no odometry has come for NO_NEWS_TIME."""
        return now - self._heard_at > NO_NEWS_TIME
