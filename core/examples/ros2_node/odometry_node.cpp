// A ROS 2 node that embeds nilio::core: sensor_msgs/PointCloud2 and Imu in, nav_msgs/Odometry and tf out.
#include <geometry_msgs/msg/transform_stamped.hpp>
#include <nav_msgs/msg/odometry.hpp>
#include <nilio/core/odometry.hpp>
#include <rclcpp/rclcpp.hpp>
#include <sensor_msgs/msg/imu.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>
#include <tf2_ros/transform_broadcaster.h>

#include "point_cloud2.hpp"

namespace core = nilio::core;

class OdometryNode : public rclcpp::Node {
 public:
  OdometryNode() : Node("nilio_odometry"), odometry_(make_config()), broadcaster_(*this) {
    publisher_ = create_publisher<nav_msgs::msg::Odometry>("odom", 10);
    imu_subscription_ =
        create_subscription<sensor_msgs::msg::Imu>("imu", rclcpp::SensorDataQoS().keep_last(1000),
                                                   [this](const sensor_msgs::msg::Imu& imu) { add(imu); });
    cloud_subscription_ = create_subscription<sensor_msgs::msg::PointCloud2>(
        "points", rclcpp::SensorDataQoS(),
        [this](const sensor_msgs::msg::PointCloud2& cloud) { add(cloud); });
  }

 private:
  /// The LiDAR is base_link here; a vehicle sets T_base_lidar and T_base_imu from tf or parameters.
  core::OdometryConfig make_config() {
    core::OdometryConfig config;
    config.threads = static_cast<int>(declare_parameter<int>("threads", 1));
    beam_spacing_rad_ =
        static_cast<float>(declare_parameter<double>("beam_spacing_deg", 2.0) * 0.017453292519943295);
    return config;
  }

  void add(const sensor_msgs::msg::Imu& imu) {
    core::ImuSample sample;
    sample.stamp = {std::int64_t{imu.header.stamp.sec} * 1'000'000'000 + imu.header.stamp.nanosec};
    sample.angular_velocity = {imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z};
    sample.linear_acceleration = {imu.linear_acceleration.x, imu.linear_acceleration.y,
                                  imu.linear_acceleration.z};
    odometry_.add_imu(sample);
  }

  void add(const sensor_msgs::msg::PointCloud2& cloud) {
    const std::string error = nilio_example::to_scan(cloud, scan_);
    if (!error.empty()) {
      RCLCPP_ERROR_THROTTLE(get_logger(), *get_clock(), 1000, "%s", error.c_str());
      return;
    }
    scan_.beam_spacing_rad = beam_spacing_rad_;
    publish(odometry_.register_scan(scan_));
    ++scan_.sequence;
  }

  void publish(const core::OdometryResult& result) {
    nav_msgs::msg::Odometry message;
    message.header.stamp = rclcpp::Time(result.scan_end.ns);
    message.header.frame_id = "odom";
    message.child_frame_id = "base_link";
    const Eigen::Vector3d& t = result.T_odom_base.translation;
    const Eigen::Quaterniond& q = result.T_odom_base.rotation;
    message.pose.pose.position.x = t.x();
    message.pose.pose.position.y = t.y();
    message.pose.pose.position.z = t.z();
    message.pose.pose.orientation.x = q.x();
    message.pose.pose.orientation.y = q.y();
    message.pose.pose.orientation.z = q.z();
    message.pose.pose.orientation.w = q.w();
    for (int i = 0; i < 36; ++i) {
      message.pose.covariance[static_cast<std::size_t>(i)] = result.pose_covariance(i / 6, i % 6);
      message.twist.covariance[static_cast<std::size_t>(i)] = result.twist_covariance(i / 6, i % 6);
    }
    message.twist.twist.linear.x = result.twist[0];
    message.twist.twist.linear.y = result.twist[1];
    message.twist.twist.linear.z = result.twist[2];
    message.twist.twist.angular.x = result.twist[3];
    message.twist.twist.angular.y = result.twist[4];
    message.twist.twist.angular.z = result.twist[5];
    publisher_->publish(message);

    geometry_msgs::msg::TransformStamped transform;
    transform.header = message.header;
    transform.child_frame_id = message.child_frame_id;
    transform.transform.translation.x = t.x();
    transform.transform.translation.y = t.y();
    transform.transform.translation.z = t.z();
    transform.transform.rotation = message.pose.pose.orientation;
    broadcaster_.sendTransform(transform);
  }

  float beam_spacing_rad_ = 0.0F;
  core::Odometry odometry_;
  core::Scan scan_;
  tf2_ros::TransformBroadcaster broadcaster_;
  rclcpp::Publisher<nav_msgs::msg::Odometry>::SharedPtr publisher_;
  rclcpp::Subscription<sensor_msgs::msg::Imu>::SharedPtr imu_subscription_;
  rclcpp::Subscription<sensor_msgs::msg::PointCloud2>::SharedPtr cloud_subscription_;
};

int main(int argc, char** argv) {
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<OdometryNode>());
  rclcpp::shutdown();
}
