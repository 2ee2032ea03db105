"""Messages that hold no scan, no marker, no cloud and no transform, sent again and again."""

import math

import rospy
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker

rospy.init_node("hostile")
marker = Marker(type=Marker.CUBE, ns="nan")
marker.header.frame_id = "odom"
marker.pose.orientation.w = marker.color.a = marker.scale.x = marker.scale.y = marker.scale.z = 1.0
marker.color.r = math.nan
mesh = Marker(type=Marker.MESH_RESOURCE, ns="mesh", mesh_resource="file:///etc/hostname", color=marker.color)
mesh.header.frame_id, mesh.pose, mesh.scale = "odom", marker.pose, marker.scale
cloud = PointCloud2(width=2, height=1, point_step=4, row_step=8, data=bytes(8))
cloud.fields = [PointField(axis, 4 * i, PointField.FLOAT32, 1) for i, axis in enumerate("xyz")]
away = TransformStamped(child_frame_id="hostile")
away.header.frame_id, away.transform.translation.x, away.transform.rotation.w = "odom", math.inf, 1.0
sent = [
    ("/hostile/markers", Marker, marker),
    ("/hostile/markers", Marker, mesh),
    ("/front/scan", LaserScan, LaserScan(ranges=[1.0, 1.0])),
    ("/camera/depth/points", PointCloud2, cloud),
    ("/tf", TFMessage, TFMessage([away])),
]
publishers = {topic: rospy.Publisher(topic, kind, queue_size=10) for topic, kind, _ in sent}
rate = rospy.Rate(20)
while not rospy.is_shutdown():
    for topic, _, msg in sent:
        publishers[topic].publish(msg)
    rate.sleep()
