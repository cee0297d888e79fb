#include "core/src/estimation/motion_filter.hpp"

#include "core/src/estimation/stationary_detector.hpp"
#include "tests/support/synthetic_imu_drive.hpp"

#include <cmath>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;
using Drive = nilio::tests::SyntheticImuDrive;
using Matrix = MotionFilter::Matrix;
using Vector = MotionFilter::Vector;

namespace {

constexpr double kScanSeconds = 0.1;
/// Correlation time of manoeuvres.
constexpr double kTau = 0.3;

/// The drive with its IMU, and its true state at any time.
struct Truth {
  Drive drive;
  ImuBuffer imu{20'000};

  explicit Truth(double seconds = 12.0) {
    for (double t = 0.0; t < seconds; t += 0.0025)
      REQUIRE(imu.add(drive.sample(t), drive.T_base_imu.rotation));
  }
  [[nodiscard]] MotionState at(double t) const {
    MotionState state;
    state.time = Time::from_seconds(t);
    constexpr double kStep = 1e-3;
    for (double s = 0.5 * kStep; s < t; s += kStep)
      state.T_map_base.translation += kStep * (Drive::rotation(s) * Vector3(Drive::speed(s), 0.0, 0.0));
    state.T_map_base.rotation = Drive::rotation(t);
    state.velocity = Vector3(Drive::speed(t), 0.0, 0.0);
    state.angular_velocity = Vector3(0.0, 0.0, Drive::rate(t));
    state.accelerometer_bias = Vector3(0.02, -0.01, 0.03);
    state.gravity = drive.tilt * Vector3(0.0, 0.0, -9.81);
    return state;
  }
  [[nodiscard]] MotionInputs inputs(bool gyro, bool accelerometer) const {
    return {&imu, drive.T_base_imu.translation, gyro, 0.01, accelerometer};
  }
};

MotionState moved_by(MotionState state, const Vector& error, bool gyro) {
  state.T_map_base = state.T_map_base * se3_exp(error.head<6>());
  state.velocity += error.segment<3>(MotionFilter::kVelocity);
  if (!gyro) state.angular_velocity += error.segment<3>(MotionFilter::kRate);
  state.gyro_bias += error.segment<3>(MotionFilter::kGyroBias);
  state.accelerometer_bias += error.segment<3>(MotionFilter::kAccelBias);
  state.gravity += error.segment<3>(MotionFilter::kGravityBlock);
  state.tilt += error.segment<3>(MotionFilter::kTilt);
  state.acceleration.head<2>() += error.segment<2>(MotionFilter::kManoeuvre);
  state.angular_acceleration.z() += error[MotionFilter::kManoeuvre + 2];
  return state;
}

Vector difference(const MotionState& from, const MotionState& to) {
  Vector result;
  result << se3_log(from.T_map_base.inverse() * to.T_map_base), to.velocity - from.velocity,
      to.angular_velocity - from.angular_velocity, to.gyro_bias - from.gyro_bias,
      to.accelerometer_bias - from.accelerometer_bias, to.gravity - from.gravity, to.tilt - from.tilt,
      (to.acceleration - from.acceleration).head<2>(),
      to.angular_acceleration.z() - from.angular_acceleration.z();
  return result;
}

/// A covariance with correlations.
Matrix some_covariance() {
  std::srand(3);
  const Matrix root = 0.1 * Matrix::Random() + 0.3 * Matrix::Identity();
  return root * root.transpose();
}

SE3 straight_on(double metres) { return {Eigen::Quaterniond::Identity(), Vector3(metres, 0.0, 0.0)}; }

/// A scan that knows its pose to `metres`, and 1 mrad.
Matrix6 information_of(double metres) {
  Vector6 variance;
  variance << Vector3::Constant(metres * metres), Vector3::Constant(1e-6);
  return variance.cwiseInverse().asDiagonal();
}

/// After so many scans of a drive straight on at 1 m/s, each known to 5 mm.
MotionFilter driven_straight_on(int scans) {
  MotionFilter filter;
  filter.reset({}, Time{0});
  for (int i = 1; i <= scans; ++i) {
    filter.propagate({}, Time::from_seconds(kScanSeconds * i));
    filter.update(straight_on(kScanSeconds * i), information_of(0.005));
  }
  return filter;
}

}  // namespace

TEST_CASE("the IMU carries the state through bends, with a lever arm, a tilted map and a bias, both ways",
          "[motion_filter]") {
  const Truth truth;
  const MotionState start = truth.at(2.0);
  const MotionState end = propagated(start, truth.inputs(true, true), Time::from_seconds(4.0));
  CHECK(difference(end, truth.at(4.0)).head<9>().norm() < 5e-3);
  const MotionState back = propagated(end, truth.inputs(true, true), start.time);
  CHECK(difference(back, start).head<9>().norm() < 1e-4);
}

TEST_CASE("the covariance follows finite differences of the motion, with and without each sensor",
          "[motion_filter]") {
  const Truth truth;
  for (const auto& [gyro, accelerometer] : {std::pair{true, true}, {true, false}, {false, false}}) {
    const MotionInputs inputs = truth.inputs(gyro, accelerometer);
    const Time end = Time::from_seconds(5.1);
    MotionState start = truth.at(5.0);
    start.angular_velocity += gyro ? Vector3::Zero() : Vector3(0.05, -0.04, 0.6);
    Matrix covariance = some_covariance();
    if (gyro) {
      // The rate's error is that of the bias.
      covariance.middleRows<3>(MotionFilter::kRate).setZero();
      covariance.middleCols<3>(MotionFilter::kRate).setZero();
    }
    MotionFilter reference(start, covariance);
    reference.propagate(inputs, end);
    for (int i = 0; i < MotionFilter::kSize; ++i) {
      if (gyro && i / 3 * 3 == MotionFilter::kRate) continue;
      // Sensors take the place of manoeuvres.
      const bool is_yaw = i == MotionFilter::kManoeuvre + 2;
      if (i >= MotionFilter::kManoeuvre && (is_yaw ? gyro : accelerometer)) continue;
      INFO("state " << i << (gyro ? ", gyro" : "") << (accelerometer ? ", accelerometer" : ""));
      // An additional variance of one state spreads along one column of the transition.
      Matrix more = covariance;
      more(i, i) += 1.0;
      MotionFilter other(start, more);
      other.propagate(inputs, end);
      const Matrix spread = other.covariance() - reference.covariance();
      constexpr double kSmall = 1e-4;
      const Vector error = kSmall * Vector::Unit(i);
      const Vector column =
          (difference(reference.state(), propagated(moved_by(start, error, gyro), inputs, end)) -
           difference(reference.state(), propagated(moved_by(start, -error, gyro), inputs, end))) /
          (2.0 * kSmall);
      Vector expected = column;
      if (gyro)
        expected.segment<3>(MotionFilter::kRate) = -error.segment<3>(MotionFilter::kGyroBias) / kSmall;
      const Matrix difference_of = spread - expected * expected.transpose();
      // The rate's row copies the bias' sign-free variance with a gyro.
      Matrix rest = difference_of;
      if (gyro) {
        rest.middleRows<3>(MotionFilter::kRate).setZero();
        rest.middleCols<3>(MotionFilter::kRate).setZero();
      }
      CHECK(rest.cwiseAbs().maxCoeff() < 0.02 * std::max(1.0, expected.squaredNorm()));
    }
  }
}

TEST_CASE("a scan updates all states as the dense information filter, also beside a bare wall",
          "[motion_filter]") {
  const Matrix covariance = some_covariance();
  Matrix6 wall = Matrix6::Zero();
  wall(1, 1) = 1e4;
  for (const Matrix6& information : {information_of(0.05), wall}) {
    MotionFilter filter({}, covariance);
    const SE3 T_map_base = se3_exp((Vector6() << 0.1, -0.2, 0.05, 0.01, -0.02, 0.03).finished());
    filter.update(T_map_base, information);
    Matrix dense = covariance.inverse();
    dense.topLeftCorner<6, 6>() += information;
    CHECK((filter.covariance() - dense.inverse()).cwiseAbs().maxCoeff() < 1e-8);
    // Unobserved states follow by their correlation with the pose.
    const Vector expected =
        covariance.leftCols<6>() * covariance.topLeftCorner<6, 6>().inverse() * se3_log(T_map_base);
    CHECK((filter.state().velocity - expected.segment<3>(MotionFilter::kVelocity)).norm() < 1e-9);
    CHECK((filter.state().gravity - expected.segment<3>(MotionFilter::kGravityBlock)).norm() < 1e-9);
  }
}

TEST_CASE("a sweep that shows its twist updates all states as the dense information filter",
          "[motion_filter]") {
  const Matrix covariance = some_covariance();
  Matrix12 information = Matrix12::Zero();
  information.topLeftCorner<6, 6>() = information_of(0.05);
  information.bottomRightCorner<6, 6>() = 0.03 * information_of(0.05);
  information(0, 6) = information(6, 0) = 2.0;
  MotionFilter filter({}, covariance);
  const SE3 T_map_base = se3_exp((Vector6() << 0.1, -0.2, 0.05, 0.01, -0.02, 0.03).finished());
  const Vector6 twist = (Vector6() << 1.0, 0.2, -0.1, 0.02, -0.03, 0.4).finished();
  filter.update(T_map_base, twist, information);
  Matrix dense = covariance.inverse();
  dense.topLeftCorner<12, 12>() += information;
  CHECK((filter.covariance() - dense.inverse()).cwiseAbs().maxCoeff() < 1e-8);
  Vector12 moved;
  moved << se3_log(T_map_base), twist;
  const Vector expected = covariance.leftCols<12>() * covariance.topLeftCorner<12, 12>().inverse() * moved;
  CHECK((filter.state().twist() - twist).norm() < 1e-9);
  CHECK((filter.state().gravity - expected.segment<3>(MotionFilter::kGravityBlock)).norm() < 1e-9);
}

TEST_CASE("the gyro tells a tilt of the map from a turn, whether or not scans show the speed",
          "[motion_filter]") {
  constexpr double kTiltPerMetre = 1e-2 * nilio::kRadiansPerDegree;
  const Truth truth;
  const MotionInputs inputs = truth.inputs(true, true);
  for (const bool shows_speed : {true, false}) {
    INFO((shows_speed ? "shown" : "not shown"));
    Matrix6 information = information_of(0.02);
    if (!shows_speed) information.row(0).setZero(), information.col(0).setZero();
    // The vehicle was stationary before.
    Vector deviations = Vector::Constant(1e-3);
    deviations.segment<3>(MotionFilter::kVelocity).setConstant(0.02);
    deviations.segment<3>(MotionFilter::kGyroBias).setConstant(0.02 * nilio::kRadiansPerDegree);
    deviations.segment<3>(MotionFilter::kTilt).setZero();
    const MotionState start = truth.at(1.0);
    MotionFilter filter(start, deviations.cwiseAbs2().asDiagonal());
    SE3 T_map_base = start.T_map_base;
    Eigen::Quaterniond tilt = Eigen::Quaterniond::Identity();
    MotionState before = start;
    for (double t = 1.0 + kScanSeconds; t < 11.0; t += kScanSeconds) {
      const MotionState now = truth.at(t);
      const SE3 motion = before.T_map_base.inverse() * now.T_map_base;
      const double angle = kTiltPerMetre * motion.translation.norm();
      T_map_base = T_map_base * motion * SE3{so3_exp(Vector3(0.0, angle, 0.0)), Vector3::Zero()};
      filter.propagate(inputs, now.time);
      const Matrix6 P = filter.pose_covariance();
      const SE3& predicted = filter.state().T_map_base;
      const Vector6 moved =
          (P.inverse() + information).inverse() * information * se3_log(predicted.inverse() * T_map_base);
      filter.update(predicted * se3_exp(moved), information);
      tilt = tilt * so3_exp(filter.take_tilt());
      before = now;
    }
    const auto angle_to_truth = [&](const Eigen::Quaterniond& rotation) {
      return so3_log(before.T_map_base.rotation.conjugate() * rotation).head<2>().norm();
    };
    const Eigen::Quaterniond& registered = filter.state().T_map_base.rotation;
    const double tilted = angle_to_truth(registered);
    CHECK(tilted > 0.8 * nilio::kRadiansPerDegree);
    CHECK(angle_to_truth(tilt * registered) < 0.6 * tilted);
    // Gravity as the accelerometer senses it.
    const Vector3 sensed = registered.conjugate() * filter.state().gravity;
    const Vector3 expected = before.T_map_base.rotation.conjugate() * start.gravity;
    CHECK((sensed - expected).norm() < 0.6 * tilted * kGravity);
    // The covariance says how well.
    const Matrix6 levelled = filter.levelled_pose_covariance();
    CHECK(levelled(4, 4) < 1.0 * nilio::kRadiansPerDegree * nilio::kRadiansPerDegree);
    CHECK(levelled(4, 4) > 0.01 * nilio::kRadiansPerDegree * nilio::kRadiansPerDegree);
  }
}

TEST_CASE("the normalised innovation is that of the scan alone", "[motion_filter]") {
  const Matrix covariance = some_covariance();
  const Matrix6 P = covariance.topLeftCorner<6, 6>();
  const Matrix6 information = information_of(0.3);
  const Vector6 innovation = (Vector6() << 0.01, 0.02, -0.01, 0.001, 0.002, -0.001).finished();
  // The pose that scan and prediction give together.
  const Vector6 moved = (P.inverse() + information).inverse() * information * innovation;
  const MotionFilter filter({}, covariance);
  const double expected = innovation.dot((P + information.inverse()).inverse() * innovation);
  CHECK(filter.normalised_innovation_squared(se3_exp(moved), information) == Approx(expected).epsilon(1e-3));
  const WeightedInnovation weighted = filter.weighted_innovation(se3_exp(moved), information);
  const Matrix6 inverse = (P + information.inverse()).inverse();
  CHECK((weighted.information - inverse).norm() < 1e-6 * inverse.norm());
  CHECK((weighted.score - inverse * innovation).norm() < 1e-3 * weighted.score.norm());
}

TEST_CASE(
    "over a gap the uncertainty grows as that of exponentially correlated manoeuvres, sway stays bounded",
    "[motion_filter]") {
  MotionState state;
  state.velocity = Vector3(20.0, 0.0, 0.0);
  state.angular_velocity = Vector3(0.3, 0.0, 0.0);
  for (const double seconds : {0.1, 0.5, 1.0, 2.0}) {
    // Variance of the position under an exponentially correlated acceleration of density 1 (Singer 1970);
    // over long gaps that of white acceleration.
    const double t = seconds;
    const double decay = std::exp(-t / kTau);
    const double expected =
        t * t * t / 3.0 - kTau * t * t / 2.0 + kTau * (kTau * kTau - kTau * (t + kTau) * decay);
    const auto deviation = [&](double density, bool speed_is_observed) {
      Matrix covariance = Matrix::Zero();
      covariance(MotionFilter::kManoeuvre, MotionFilter::kManoeuvre) = density / (2.0 * kTau);
      MotionFilter filter(state, covariance);
      MotionInputs inputs;
      inputs.speed_is_observed = speed_is_observed;
      filter.propagate(inputs, Time::from_seconds(seconds));
      // A rolling body swings back: 0.3 rad/s for 0.3 s at most.
      CHECK(so3_log(filter.state().T_map_base.rotation).norm() < 0.091);
      CHECK(filter.state().T_map_base.translation.norm() == Approx(20.0 * seconds).epsilon(0.01));
      return std::sqrt(filter.covariance()(0, 0));
    };
    // 2 a^2 tau of 2 m/s^2 for a second: 8 m^2/s^3; of 0.5 m/s^2 where no scan showed the speed.
    CHECK(deviation(8.0, true) == Approx(std::sqrt(8.0 * expected)).epsilon(0.01));
    CHECK(deviation(0.5, false) == Approx(std::sqrt(0.5 * expected)).epsilon(0.01));
    CHECK(expected < t * t * t / 3.0);
  }
}

TEST_CASE("a clock that jumps by a year, ahead or back, moves the pose by ten seconds at most",
          "[motion_filter]") {
  MotionFilter filter;
  filter.reset({}, Time::from_seconds(1e8));
  filter.set_twist((Vector6() << 20.0, 0.0, 0.0, 0.0, 0.0, 0.0).finished(), Vector6::Constant(1e-2));
  for (const double year : {1e8 + 3.2e7, 1e8}) {
    const double from = filter.state().T_map_base.translation.x();
    filter.propagate({}, Time::from_seconds(year));
    CHECK(filter.state().time == Time::from_seconds(year));
    const double moved = filter.state().T_map_base.translation.x() - from;
    CHECK(moved == Approx(year > 1e8 ? 200.0 : 0.0).margin(1e-6));
    CHECK(filter.covariance().allFinite());
  }
}

TEST_CASE("a constant acceleration is followed without an IMU, and ends with it", "[motion_filter]") {
  MotionFilter filter;
  filter.reset({}, Time{0});
  const auto path = [](double t) { return straight_on(10.0 * t - 2.5 * t * t); };
  double t = 0.0;
  for (int i = 1; i <= 10; ++i) {
    t = kScanSeconds * i;
    filter.propagate({}, Time::from_seconds(t));
    filter.update(path(t), information_of(0.005));
  }
  CHECK(filter.state().velocity.x() == Approx(10.0 - 5.0 * t).margin(0.1));
  filter.propagate({}, Time::from_seconds(t + kScanSeconds));
  CHECK(filter.state().T_map_base.translation.x() ==
        Approx(path(t + kScanSeconds).translation.x()).margin(0.02));
  // Nobody brakes for ever.
  filter.propagate({}, Time::from_seconds(t + 10.0));
  CHECK(filter.state().velocity.x() > 2.0);
}

TEST_CASE("the prediction expects roll and pitch as fast as the scans have shown them", "[motion_filter]") {
  // A road, and a track on which the vehicle pitches by 3 degrees every second.
  const auto rate_deviation = [](double pitch_rad) {
    MotionFilter filter;
    filter.reset({}, Time{0});
    double squares = 0.0;
    for (int i = 1; i <= 150; ++i) {
      const double t = kScanSeconds * i;
      SE3 truth = straight_on(10.0 * t);
      truth.rotation = so3_exp({0.0, pitch_rad * std::sin(2.0 * M_PI * t), 0.0});
      filter.propagate({}, Time::from_seconds(t));
      if (i > 100) {
        const double error = so3_log(filter.state().T_map_base.rotation.conjugate() * truth.rotation).y();
        squares += error * error / filter.pose_covariance()(4, 4) / 50.0;
      }
      filter.update(truth, information_of(0.005));
    }
    CHECK(squares < 2.0);
    filter.propagate({}, Time::from_seconds(15.1));
    return std::sqrt(filter.twist_covariance()(4, 4));
  };
  const double on_road = rate_deviation(0.0);
  const double off_road = rate_deviation(3.0 * nilio::kRadiansPerDegree);
  CHECK(on_road < 0.5 * MotionFilter::kSwayRate);
  CHECK(off_road > MotionFilter::kSwayRate);
  // Not more than the rates that there are: 19 degrees a second.
  CHECK(off_road < 6.0 * M_PI * nilio::kRadiansPerDegree);
}

TEST_CASE("a new map begins where the vehicle is, and its motion goes on", "[motion_filter]") {
  MotionFilter filter = driven_straight_on(20);
  filter.propagate({}, Time::from_seconds(4.0));
  const MotionFilter before = filter;
  filter.begin_map();
  CHECK(filter.state().T_map_base.translation == before.state().T_map_base.translation);
  CHECK(filter.state().twist() == before.state().twist());
  CHECK(filter.twist_covariance() == before.twist_covariance());
  CHECK(filter.pose_covariance()(0, 0) < 1e-3 * before.pose_covariance()(0, 0));
  CHECK(filter.covariance().topRightCorner(6, MotionFilter::kSize - 6).isZero());
}

TEST_CASE("the distance of a relocalised pose is in deviations of the prediction", "[motion_filter]") {
  MotionFilter filter;
  filter.reset({}, Time{0});
  filter.set_twist(Vector6::Zero(), Vector6::Constant(0.25));
  filter.propagate({}, Time::from_seconds(2.0));
  const double deviation = std::sqrt(filter.pose_covariance()(0, 0));
  REQUIRE(deviation > 0.5);
  SE3 pose = filter.state().T_map_base;
  CHECK(filter.squared_distance(pose) == Approx(0.0).margin(1e-12));
  pose.translation.x() += 2.0 * deviation;
  CHECK(filter.squared_distance(pose) == Approx(4.0).epsilon(0.05));
}

TEST_CASE("a corner that the prediction did not expect widens the yaw alone", "[motion_filter]") {
  const MotionFilter before = driven_straight_on(10);
  const Time next = Time::from_seconds(1.1);
  MotionFilter plain = before;
  plain.propagate({}, next);
  SE3 registered = plain.state().T_map_base;
  registered.rotation = registered.rotation * so3_exp({0.0, 0.0, 0.1});
  MotionFilter adapting = plain;
  CHECK_FALSE(adapting.adapt_to_manoeuvre(plain.state().T_map_base, {}));
  REQUIRE(adapting.adapt_to_manoeuvre(registered, {}));
  MotionFilter adapted = before;
  adapted.adapt_as(adapting);
  adapted.propagate({}, next);
  const Vector6 ratio =
      (adapted.pose_covariance().diagonal().array() / plain.pose_covariance().diagonal().array()).matrix();
  CHECK(ratio[5] > 10.0);
  CHECK(ratio[0] < 1.1);
  CHECK(ratio[2] < 1.1);
  CHECK(ratio[3] < 1.1);
  // Scans that agree again narrow it.
  for (MotionFilter* filter : {&adapted, &plain}) {
    filter->update(registered, information_of(0.005));
    for (int i = 2; i < 8; ++i) {
      filter->propagate({}, Time::from_seconds(1.0 + kScanSeconds * i));
      filter->update(filter->state().T_map_base, information_of(0.005));
    }
  }
  CHECK(adapted.twist_covariance()(5, 5) == Approx(plain.twist_covariance()(5, 5)).epsilon(0.05));
}

TEST_CASE("scans estimate gyro bias, gravity and velocity within their covariance", "[motion_filter]") {
  const Truth truth;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  double squares = 0.0;
  constexpr int kRuns = 30;
  for (int run = 0; run < kRuns; ++run) {
    const auto noise = [&](double deviation) {
      return Vector3(deviation * Vector3(normal(random), normal(random), normal(random)));
    };
    const Vector3 bias = noise(0.005);
    ImuBuffer imu(20'000);
    for (double t = 0.0; t < 11.0; t += 0.0025) {
      ImuSample sample = truth.drive.sample(t);
      const Vector3 measured = truth.drive.T_base_imu.rotation.conjugate() * bias;
      for (std::size_t i = 0; i < 3; ++i) sample.angular_velocity[i] += measured[static_cast<int>(i)];
      REQUIRE(imu.add(sample, truth.drive.T_base_imu.rotation));
    }
    MotionInputs inputs = truth.inputs(true, true);
    inputs.imu = &imu;
    MotionFilter filter;
    filter.reset(truth.at(0.05).T_map_base, Time::from_seconds(0.05));
    filter.set_gravity(truth.at(0.05).T_map_base.rotation *
                           mean_specific_force(imu, Time::from_seconds(0.05), Time::from_seconds(0.15)),
                       1.5 * 1.5);
    for (double t = 0.15; t < 10.0; t += kScanSeconds) {
      const SE3 seen = truth.at(t).T_map_base * SE3{so3_exp(noise(1e-3)), noise(0.005)};
      filter.propagate(inputs, Time::from_seconds(t));
      const Matrix6 information = information_of(0.005);
      const Matrix6 P = filter.pose_covariance();
      const Vector6 moved =
          P * (P + information.inverse()).inverse() * se3_log(filter.state().T_map_base.inverse() * seen);
      filter.update(filter.state().T_map_base * se3_exp(moved), information);
    }
    CHECK((filter.state().gyro_bias - bias).norm() < 2e-3);
    CHECK(filter.state().gravity.norm() == Approx(9.81).margin(0.3));
    const Vector3 wrong = filter.state().velocity - truth.at(filter.state().time.seconds()).velocity;
    const Matrix3 variance =
        filter.covariance().block<3, 3>(MotionFilter::kVelocity, MotionFilter::kVelocity);
    squares += wrong.dot(variance.inverse() * wrong) / 3.0;
  }
  // The samples have no noise, so that the errors are those of the scans.
  CHECK(squares / kRuns < 1.5);
  CHECK(squares / kRuns > 0.05);
}

TEST_CASE("while the vehicle brakes, the covariance covers an accelerometer with a wrong scale",
          "[motion_filter]") {
  constexpr double kSeconds = 2.0;
  constexpr double kScale = 1.02;
  for (const double acceleration : {-5.0, 0.0}) {
    ImuBuffer imu(1000);
    for (double t = 0.0; t < kSeconds + 0.1; t += 0.0025)
      REQUIRE(imu.add({Time::from_seconds(t), {}, {kScale * acceleration, 0.0, 9.81}},
                      Eigen::Quaterniond::Identity()));
    MotionState state;
    state.velocity = Vector3(15.0, 0.0, 0.0);
    state.gravity = Vector3(0.0, 0.0, -9.81);
    MotionFilter filter(state, Matrix::Zero());
    filter.propagate({&imu, Vector3::Zero(), true, true, true}, Time::from_seconds(kSeconds));
    const double error = filter.state().velocity.x() - (15.0 + acceleration * kSeconds);
    CHECK(error == Approx((kScale - 1.0) * acceleration * kSeconds).margin(1e-3));
    const double deviation = std::sqrt(filter.covariance()(MotionFilter::kVelocity, MotionFilter::kVelocity));
    CHECK(deviation > std::abs(error));
    // At a steady speed there is nothing to scale.
    CHECK(deviation < (acceleration == 0.0 ? 0.04 : 2.0 * std::abs(error)));
  }
}

TEST_CASE("a vehicle at rest has no velocity and shows the gyro's bias", "[motion_filter]") {
  ImuBuffer imu(1000);
  const Vector3 bias(0.002, -0.003, 0.004);
  for (int i = 0; i < 200; ++i)
    REQUIRE(imu.add({Time::from_seconds(0.005 * i), {0.002, -0.003, 0.004}, {0.0, 0.0, 9.81}},
                    Eigen::Quaterniond::Identity()));
  const MotionInputs inputs{&imu, Vector3::Zero(), true, false, false};
  MotionFilter filter;
  filter.reset({}, Time{0});
  for (int i = 1; i < 9; ++i) {
    filter.propagate(inputs, Time::from_seconds(0.1 * i));
    filter.zero_velocity_update();
  }
  CHECK(filter.state().velocity.norm() < 0.02);
  CHECK((filter.state().gyro_bias - bias).norm() < 5e-4);
  CHECK(filter.may_be_stationary());
}
