#include "tests/support/paths.hpp"
#include "tests/support/room_drive.hpp"
#include "tests/support/tools/record_support.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <sys/wait.h>
#include <vector>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <yaml-cpp/yaml.h>

using namespace nilio;
using tests::NilioProcess;
using tests::TemporaryFolder;

namespace {

namespace fs = std::filesystem;

const std::string kExamples = nilio::tests::source_folder() + "/tools/examples/";

/// Exit status of a shell command with the built programs in front of PATH; its output is in `log`.
int run_shell(const std::string& command, const fs::path& log) {
  const std::string line =
      "PATH=" + nilio::tests::program_folder() + ":$PATH; " + command + " > " + log.string() + " 2>&1";
  const int status = std::system(line.c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/// Two recordings, the second of which does not exist, and their list.
std::string write_list(const TemporaryFolder& folder) {
  fs::create_directory(folder.path() / "drive 1");
  tests::write_room_drive(folder.path() / "drive 1", tests::s_curve, 1.5, false);
  return folder.write("list.txt", folder.file("drive 1") + "\n" + folder.file("gone") + "\n");
}

void check_result(const fs::path& run, const std::string& recording) {
  const auto result = nlohmann::json::parse(tests::read_file(run / "result.json"));
  CHECK(result["exit_status"] == 0);
  CHECK(result["inputs"][0]["path"].get<std::string>().find(recording) == 0);
  CHECK(result["poses"].get<int>() >= 14);
}

}  // namespace

TEST_CASE("a task of the Slurm array replays its line of the list, and ends with niliod's status",
          "[examples]") {
  const TemporaryFolder folder;
  const std::string list = write_list(folder);
  const fs::path log = folder.path() / "log";
  const auto task = [&](int index) {
    return run_shell("SLURM_ARRAY_TASK_ID=" + std::to_string(index) + " bash " + kExamples +
                         "slurm_array.sh " + list + " " + folder.file("runs"),
                     log);
  };
  CHECK(task(0) == 0);
  check_result(folder.path() / "runs" / "00000-drive 1", folder.file("drive 1"));
  // A requeued task.
  CHECK(task(0) == 0);
  CHECK(task(1) == 1);
  CHECK(tests::read_file(log).find("gone") != std::string::npos);
  CHECK(task(2) == 2);
  CHECK(tests::read_file(log).find("has no line 3") != std::string::npos);
  CHECK(run_shell("nilio report " + folder.file("runs") + "/*", log) == 0);
  INFO(tests::read_file(log));
  CHECK(tests::read_file(log).find("1 runs, 0 with a problem") != std::string::npos);
  CHECK(run_shell("nilio report " + folder.file("runs") + "/* " + folder.file("runs/00001-gone"), log) == 3);
}

TEST_CASE("the Kubernetes Job is complete, and its command replays the pod's line of the list",
          "[examples]") {
  const std::vector<YAML::Node> documents = YAML::LoadAllFromFile(kExamples + "kubernetes_job.yaml");
  REQUIRE(documents.size() == 2);
  const YAML::Node list = documents[0];
  const YAML::Node job = documents[1];
  CHECK(list["kind"].as<std::string>() == "ConfigMap");
  CHECK(job["apiVersion"].as<std::string>() == "batch/v1");
  CHECK(job["kind"].as<std::string>() == "Job");
  CHECK_FALSE(job["metadata"]["name"].as<std::string>().empty());
  const YAML::Node spec = job["spec"];
  CHECK(spec["completionMode"].as<std::string>() == "Indexed");
  const auto lines = list["data"]["list.txt"].as<std::string>();
  CHECK(std::count(lines.begin(), lines.end(), '\n') == spec["completions"].as<int>());
  const YAML::Node pod = spec["template"]["spec"];
  // Both are required by podFailurePolicy.
  CHECK(pod["restartPolicy"].as<std::string>() == "Never");
  CHECK(spec["backoffLimitPerIndex"].as<int>() > 0);
  const YAML::Node container = pod["containers"][0];
  const YAML::Node rule = spec["podFailurePolicy"]["rules"][0];
  CHECK(rule["action"].as<std::string>() == "FailIndex");
  CHECK(rule["onExitCodes"]["containerName"].as<std::string>() == container["name"].as<std::string>());
  CHECK(rule["onExitCodes"]["values"].as<std::vector<int>>() == std::vector<int>{2, 3});
  // Every mount has its volume.
  for (const YAML::Node& mount : container["volumeMounts"]) {
    bool found = false;
    for (const YAML::Node& volume : pod["volumes"])
      found = found || volume["name"].as<std::string>() == mount["name"].as<std::string>();
    CHECK(found);
  }

  const TemporaryFolder folder;
  const std::string list_file = write_list(folder);
  REQUIRE(container["command"].as<std::vector<std::string>>() == std::vector<std::string>{"sh", "-ec"});
  const std::string script = folder.write("command.sh", container["args"][0].as<std::string>());
  const auto run_pod = [&](int index) {
    return run_shell("LIST=" + list_file + " RESULTS=" + folder.file("results") +
                         " JOB_COMPLETION_INDEX=" + std::to_string(index) + " sh -e " + script,
                     folder.path() / "log");
  };
  CHECK(run_pod(0) == 0);
  check_result(folder.path() / "results" / "0-drive 1", folder.file("drive 1"));
  CHECK(run_pod(1) == 1);
  CHECK(run_pod(2) == 2);
}
