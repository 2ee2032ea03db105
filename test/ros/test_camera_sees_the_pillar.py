"""The depth camera of kinect_enabled:=true: images, points, and the frame that ties them to the robot."""

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from harness import RosTest, simulator_service, stamp
from husky_highlevel_controller.srv import DeleteObject, MoveObject, SpawnObject
from sensor_msgs.msg import CameraInfo, Image, LaserScan, PointCloud2

from husky_highlevel_controller.geometry import transform_point
from husky_highlevel_controller.ros.conversions import pose_from_transform


class CameraSeesThePillar(RosTest):
    def test_the_pillar_stands_in_the_cloud_where_it_stands_in_the_world(self):
        buffer = tf2_ros.Buffer()
        tf2_ros.TransformListener(buffer)
        clouds = self.remember("camera/depth/points", PointCloud2)
        self.wait_until(lambda: clouds, "there is a cloud")
        cloud = clouds[-1]
        self.assertEqual(cloud.header.frame_id, "camera_frame_optical")
        points = np.frombuffer(cloud.data, "<f4").reshape(cloud.height, cloud.width, 3)
        near = points[np.isfinite(points).all(axis=2)]
        self.wait_until(
            lambda: buffer.can_transform("base_link", cloud.header.frame_id, rospy.Time(0)), "TF knows it"
        )
        camera = pose_from_transform(
            buffer.lookup_transform("base_link", cloud.header.frame_id, rospy.Time(0))
        )
        in_base = np.array([transform_point(camera, point) for point in near[::7].tolist()])
        ground, pillar = in_base[in_base[:, 2] < -0.10], in_base[in_base[:, 2] > 0.0]
        self.assertGreater(len(pillar), 200)
        self.assertAlmostEqual(float(np.median(ground[:, 2])), -0.132, delta=0.02)
        self.assertAlmostEqual(float(pillar[:, 0].min()), 3.0 - 0.2, delta=0.03, msg="its near side")
        self.assertLess(float(np.abs(pillar[:, 1]).max()), 0.22, "its radius")

    def test_a_static_object_is_drawn_where_it_was_moved(self):
        images = self.remember("camera/depth/image_raw", Image)

        def depth():
            """Depth of the middle of the newest image [m]; -1 before the first one."""
            return (
                float(np.frombuffer(images[-1].data, "<f4").reshape(240, 320)[120, 160]) if images else -1.0
            )

        place = Pose(Point(18.5, 5.0, 0.5), Quaternion(w=1.0))
        wall = {"model_name": "wall", "shape": "box", "size": Vector3(0.2, 1.0, 1.0), "initial_pose": place}
        self.assertTrue(simulator_service("spawn", SpawnObject)(**wall).success)
        self.addCleanup(simulator_service("delete", DeleteObject), "wall")
        self.wait_until(lambda: 0.0 < depth() < 1.5, "the wall is seen")
        place.position.y = 9.0
        self.assertTrue(simulator_service("move", MoveObject)(model_name="wall", pose=place).success)
        self.wait_until(lambda: depth() > 2.5, "the wall is seen no more")

    def test_image_and_calibration_fit_together_and_come_at_their_rate(self):
        images = self.remember("camera/depth/image_raw", Image)
        infos = self.remember("camera/depth/camera_info", CameraInfo)
        scans = self.remember("front/scan", LaserScan)
        self.wait_until(lambda: len(images) > 5 and len(infos) > 5, "there are images")
        image, info = images[-1], infos[-1]
        self.assertEqual((image.encoding, image.height, image.width), ("32FC1", 240, 320))
        self.assertEqual((info.height, info.width, info.K[2], info.K[5]), (240, 320, 159.5, 119.5))
        depth = np.frombuffer(image.data, "<f4").reshape(240, 320)
        self.assertAlmostEqual(float(depth[120, 160]), 2.77, delta=0.03)
        gaps = np.diff([stamp(msg) for msg in images])
        # one may be left out where the machine is busy, none comes early
        self.assertTrue(np.allclose(np.round(gaps / 0.1, 6) % 1.0, 0.0), gaps)
        self.assertGreaterEqual(gaps.min(), 0.1 - 1e-6)
        self.assertTrue(np.allclose(np.diff([stamp(msg) for msg in scans]), 0.02), "no scan is missing")
