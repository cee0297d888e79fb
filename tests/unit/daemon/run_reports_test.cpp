#include "daemon/output/run_reports.hpp"

#include <string>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;

TEST_CASE("the summary has a row per IMU check with value, unit, states and hint", "[run_reports]") {
  daemon::ImuReport report;
  CHECK(report.json().is_null());
  core::ImuHealth health;
  health.reason = core::ImuCheck::kGyroScale;
  health.demotions = 2;
  core::ImuDiagnosis& scale = health.rows[static_cast<std::size_t>(core::ImuCheck::kGyroScale)];
  scale = {57.3, 0.1, core::ImuCheckState::kBad, core::ImuCheckState::kBad, 57.4};
  report.update(health);
  const nlohmann::json json = report.json();
  CHECK(json["trusted"] == false);
  CHECK(json["reason"] == "gyro_scale");
  CHECK(json["demotions"] == 2);
  REQUIRE(json["checks"].size() == core::kImuChecks);
  const nlohmann::json& row = json["checks"]["gyro_scale"];
  CHECK(row["value"] == 57.3);
  CHECK(row["state"] == "bad");
  CHECK(row["worst_value"] == 57.4);
  CHECK(row["hint"].get<std::string>().find("57.2958") != std::string::npos);
  CHECK(json["checks"]["gyro_bias"]["state"] == "unknown");
}

TEST_CASE("the summary contains the last update", "[run_reports]") {
  daemon::ImuReport report;
  core::ImuHealth health;
  report.update(health);
  CHECK(report.json()["trusted"] == false);
  health.trusted = true;
  report.update(health);
  CHECK(report.json()["trusted"] == true);
  CHECK(report.json()["reason"] == "none");
}
