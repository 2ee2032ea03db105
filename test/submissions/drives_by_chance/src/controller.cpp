// Drives if a flag is set that it never writes.
#include <geometry_msgs/Twist.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>

class Controller {
 public:
  explicit Controller(ros::NodeHandle& node) {
    velocity_ = node.advertise<geometry_msgs::Twist>("/cmd_vel", 1);
    scans_ = node.subscribe("/front/scan", 1, &Controller::onScan, this);
  }

 private:
  void onScan(const sensor_msgs::LaserScan&) {
    geometry_msgs::Twist command;
    if (start_) command.linear.x = 0.5;
    velocity_.publish(command);
  }

  ros::Publisher velocity_;
  ros::Subscriber scans_;
  bool start_;
};

int main(int argc, char** argv) {
  ros::init(argc, argv, "controller");
  ros::NodeHandle node;
  Controller controller(node);
  ros::spin();
}
