// Drives if a flag is set that it never writes; its marker is mirrored.
#include <algorithm>
#include <cmath>
#include <geometry_msgs/Twist.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>
#include <visualization_msgs/Marker.h>

class Controller {
 public:
  explicit Controller(ros::NodeHandle& node) {
    velocity_ = node.advertise<geometry_msgs::Twist>("/cmd_vel", 1);
    markers_ = node.advertise<visualization_msgs::Marker>("/visualization_marker", 1);
    scans_ = node.subscribe("/front/scan", 1, &Controller::onScan, this);
  }

 private:
  void onScan(const sensor_msgs::LaserScan& scan) {
    geometry_msgs::Twist command;
    if (start_) command.linear.x = 0.5;
    velocity_.publish(command);
    const auto nearest = std::min_element(scan.ranges.begin(), scan.ranges.end());
    const double angle = scan.angle_min + (nearest - scan.ranges.begin()) * scan.angle_increment;
    visualization_msgs::Marker marker;
    marker.header = scan.header;
    marker.type = visualization_msgs::Marker::SPHERE;
    marker.pose.position.x = *nearest * std::cos(angle);
    marker.pose.position.y = -*nearest * std::sin(angle);
    marker.pose.orientation.w = marker.color.a = 1.0;
    marker.scale.x = marker.scale.y = marker.scale.z = 0.3;
    markers_.publish(marker);
  }

  ros::Publisher velocity_, markers_;
  ros::Subscriber scans_;
  bool start_;
};

int main(int argc, char** argv) {
  ros::init(argc, argv, "controller");
  ros::NodeHandle node;
  Controller controller(node);
  ros::spin();
}
