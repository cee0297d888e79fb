#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/report/results_page.hpp"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::tools::bench {

// Each benchmark of `nilio bench` has a struct of options, with its defaults, and a function. The function
// prints its tables. It returns false when a requirement failed and an error when something could not be run.

/// `nilio bench decode`: CPU time from packets to scans on one core, for every sensor model or for a capture.
struct DecodeOptions {
  std::string capture;  ///< decode these packets instead of generated ones

  int rounds = 15;        ///< passes over the packets; the median counts
  double seconds = 1.0;   ///< of packets in a pass
  double missing = 0.13;  ///< share of firings without a return
};
core::Result<bool> run_decode_bench(const DecodeOptions& options);

/// `nilio bench receive`: numbered packets over loopback, each of them accounted for.
struct ReceiveOptions {
  std::vector<double> speeds{1.0, 4.0};  ///< multiples of a VLS-128's packet rate
  double seconds = 5.0;                  ///< length of a trial
  double stall_ms = 0.0;                 ///< sleep of the receive thread; 0 = none
  double stall_period_ms = 1000.0;
  int receive_buffer_bytes = 8 * 1024 * 1024;
  std::size_t ring_slots = 8192;
};
core::Result<bool> run_receive_bench(const ReceiveOptions& options);

/// `nilio bench odometry`: accuracy, time, memory and work on drives with a truth.
struct OdometryOptions {
  std::vector<std::string> datasets;  ///< FOLDER or FOLDER:TRUTH
  std::vector<std::string> registrations{"ndt_icp"};
  std::vector<int> threads{1};
  std::vector<std::string> overrides;  ///< "key=value" of the configuration
  int repeats = 1;                     ///< runs for each figure; the minimum of each scan counts
  bool with_pcl = false;               ///< also runs the Point Cloud Library's methods
  bool ablation = false;               ///< also runs with one setting changed at a time
  ResultsPage::Options page;
};
core::Result<bool> run_odometry_bench(const OdometryOptions& options);

/// `nilio bench basin`: convergence basin of each registration method.
struct BasinOptions {
  std::vector<std::string> datasets;
  std::vector<std::string> registrations{"all"};
  std::vector<std::string> overrides;
  std::size_t pairs = 200;  ///< scans to try, shared among the data sets
  std::uint64_t seed = 1;
  ResultsPage::Options page;
};
core::Result<bool> run_basin_bench(const BasinOptions& options);

/// `nilio bench sharpness`: sharpness of local maps, which needs no truth, for nilio and its peers.
struct SharpnessBenchOptions {
  std::string drive;               ///< KITTI odometry sequence or raw drive
  std::vector<std::string> peers;  ///< "NAME=FILE", 12 numbers a line: the pose of the LiDAR at each scan
  std::string deskew_from;         ///< trajectory that compensates the motion of all scans; empty = none
  double elevation_correction_deg = 0.205;
  std::vector<std::string> overrides;
  std::string json;
  ResultsPage::Options page;
};
core::Result<bool> run_sharpness_bench(const SharpnessBenchOptions& options);

/// `nilio bench matrix`: success, drift and silent errors over scenes, sensors, IMU and faults.
struct MatrixOptions {
  bool quick = false;                ///< short drives, fixed seeds
  bool effects = false;              ///< the town with each effect of realism alone
  bool list = false;                 ///< only print the names of the rows
  std::string rows;                  ///< pattern of a shell; empty = all
  std::size_t runs = 12;             ///< drawn seeds of a simulated drive
  std::size_t sample = 0;            ///< rows that the commit draws; 0 = all
  double minutes = 0.0;              ///< ends after this time; 0 = no limit
  std::string repeat;                ///< result whose runs are repeated and compared; empty = none
  std::string resume;                ///< result whose runs are kept, the missing ones run; empty = none
  std::vector<std::uint64_t> seeds;  ///< instead of drawn ones
  std::string commit;                ///< that the seeds are drawn from; empty = of the working folder
  std::string data;                  ///< real recordings; empty = NILIO_DATA
  std::string drives;                ///< folder to keep the drives in; empty = temporary
  std::vector<std::string> peers;    ///< "NAME=FOLDER"
  std::string baseline;              ///< result to compare with; empty = none
  std::vector<std::string> overrides;
  std::size_t jobs = 2;
  std::string json;
  ResultsPage::Options page;
};
/// Status of a benchmark that a signal stopped, with the page of what was done: 128 + SIGINT, as shells have
/// it.
inline constexpr int kInterrupted = 130;
/// The exit status: 0, 3 where it is worse than the baseline, or kInterrupted.
core::Result<int> run_matrix_bench(const MatrixOptions& options);

/// Length and settings of soak runs.
struct SoakPlan {
  double minutes = 0.0;             ///< recorded time of driving; 0 = none
  double stationary_minutes = 0.0;  ///< recorded time of a simulated standstill; 0 = none
  double warm_up_share = 0.25;      ///< share of the time before the memory is checked
  std::vector<std::string> overrides;
  std::uint32_t domain = 0;  ///< DDS
};

/// `nilio bench soak`: hours of recorded driving as fast as possible, with the memory checked for growth.
struct SoakOptions {
  std::vector<std::string> drives;
  SoakPlan plan{.minutes = 60.0, .overrides = {}};
  ResultsPage::Options page;
};
core::Result<bool> run_soak_bench(const SoakOptions& options);

/// `nilio bench realtime`: niliod and its publisher at the sensor's pace, under budgets and loads.
struct RealtimeOptions {
  std::vector<std::string> drives;
  std::vector<double> budgets_ms{50.0, 20.0, 10.0, 5.0, 2.0, 1.0};
  /// condition_name()
  std::vector<std::string> conditions{"idle",       "cpu",     "memory",    "subscriber", "nice",
                                      "nice-later", "foreign", "slow-disk", "full-disk"};
  bool conditions_only = false;     ///< no budgets, no identity checks
  bool full = false;                ///< every budget under every condition
  double seconds = 15.0;            ///< length of a run: the beginning of the drive
  std::string feed = "udp";         ///< or "replay"
  std::uint64_t memory_mib = 4096;  ///< maximum of condition "memory"
  std::string can_interface;        ///< sends the IMU's frames there; empty = no IMU over UDP
  std::uint16_t port = 0;           ///< UDP port to send to; 0 = any free one
  std::vector<std::string> overrides;
  SoakPlan soak;
  ResultsPage::Options page;
};
core::Result<bool> run_realtime_bench(const RealtimeOptions& options);

}  // namespace nilio::tools::bench
