#include <geometry_msgs/Twist.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>

ros::Publisher velocity;

void onScan(const sensor_msgs::LaserScan& scan) {
  geometry_msgs::Twist command;
  const float ahead = scan.ranges[scan.ranges.size() / 2];  // [m]
  command.linear.x = ahead > 2.0 ? 0.5 : 0.0;               // [m/s]
  velocity.publish(command);
}

int main(int argc, char** argv) {
  ros::init(argc, argv, "drive");
  ros::NodeHandle node;
  velocity = node.advertise<geometry_msgs::Twist>("/cmd_vel", 1);
  ros::Subscriber scans = node.subscribe("/front/scan", 1, onScan);
  ros::spin();
}
