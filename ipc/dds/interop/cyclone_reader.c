// Reads odometry, the transform and diagnostics with CycloneDDS, from code that idlc generates from our IDL,
// and prints each field of what it receives on one line, floating-point numbers in hexadecimal so that
// nothing is lost.
//
//   nilio-cyclone-reader DOMAIN COUNT TIMEOUT_S [imu|clouds|map|arrivals|promises]
//
// Ends after COUNT poses and transforms and one array of diagnostics (status 0) or after TIMEOUT_S (status
// 1). With "imu": after COUNT poses at IMU rate, one status of them and one report of a scan. With "clouds":
// after COUNT registered scans for a reliable and for a best-effort reader, and one path.
//
// With "arrivals": prints CLOCK_MONOTONIC, in ns, of every odometry message and of every change of the
// publisher's state as soon as they arrive, and ends after COUNT messages:
//
//   waiting NOW                    the reader is there
//   arrival NOW SEC NANOSEC        odometry with this stamp
//   report NOW SEC NANOSEC [NAME=NS]...  scan report of this stamp with the times of its stages
//   matched NOW COUNT              number of publishers
//   alive NOW COUNT NOT_ALIVE      number of publishers that keep their liveliness, and that do not
//   deadline NOW TOTAL             a message is overdue
//
// "promises" requests the deadline and liveliness that nilio offers, instead of the defaults.

#define _POSIX_C_SOURCE 200809L  // NOLINT: clock_gettime
#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "dds/dds.h"
#include "nilio.h"

static void print_numbers(const double* numbers, size_t count) {
  for (size_t i = 0; i < count; ++i) printf(" %a", numbers[i]);
}

static void print_header(const char* kind, const std_msgs_msg_dds__Header_* header, const char* child_frame) {
  printf("%s %" PRId32 " %" PRIu32 " %s %s", kind, header->stamp.sec, header->stamp.nanosec, header->frame_id,
         child_frame);
}

static int print_odometry(const void* sample) {
  const nav_msgs_msg_dds__Odometry_* odometry = sample;
  const geometry_msgs_msg_dds__Pose_* pose = &odometry->pose.pose;
  const geometry_msgs_msg_dds__Twist_* twist = &odometry->twist.twist;
  print_header("odometry", &odometry->header, odometry->child_frame_id);
  print_numbers((double[]){pose->position.x, pose->position.y, pose->position.z}, 3);
  print_numbers(
      (double[]){pose->orientation.x, pose->orientation.y, pose->orientation.z, pose->orientation.w}, 4);
  print_numbers(odometry->pose.covariance, 36);
  print_numbers((double[]){twist->linear.x, twist->linear.y, twist->linear.z}, 3);
  print_numbers((double[]){twist->angular.x, twist->angular.y, twist->angular.z}, 3);
  print_numbers(odometry->twist.covariance, 36);
  printf("\n");
  return 1;
}

static int print_transforms(const void* sample) {
  const tf2_msgs_msg_dds__TFMessage_* message = sample;
  for (uint32_t i = 0; i < message->transforms._length; ++i) {
    const geometry_msgs_msg_dds__TransformStamped_* stamped = &message->transforms._buffer[i];
    const geometry_msgs_msg_dds__Transform_* transform = &stamped->transform;
    print_header("transform", &stamped->header, stamped->child_frame_id);
    print_numbers((double[]){transform->translation.x, transform->translation.y, transform->translation.z},
                  3);
    print_numbers((double[]){transform->rotation.x, transform->rotation.y, transform->rotation.z,
                             transform->rotation.w},
                  4);
    printf("\n");
  }
  return 1;
}

static int print_diagnostics(const void* sample) {
  const diagnostic_msgs_msg_dds__DiagnosticArray_* array = sample;
  for (uint32_t i = 0; i < array->status._length; ++i) {
    const diagnostic_msgs_msg_dds__DiagnosticStatus_* status = &array->status._buffer[i];
    printf("diagnostics %u [%s] [%s]", (unsigned)status->level, status->name, status->message);
    for (uint32_t k = 0; k < status->values._length; ++k)
      printf(" [%s=%s]", status->values._buffer[k].key, status->values._buffer[k].value);
    printf("\n");
  }
  return 1;
}

static int print_status(const void* sample) {
  const nilio_msg_dds__ImuPoseStatus_* status = sample;
  printf("status %" PRId32 " %" PRIu32 " %" PRId32 " %" PRIu32 " %" PRIu64 " %a %a %d %d %" PRIu64 " %" PRIu64
         " %" PRIu64 " %" PRIu64 "\n",
         status->stamp.sec, status->stamp.nanosec, status->scan_stamp.sec, status->scan_stamp.nanosec,
         status->scan_sequence, status->correction_m, status->correction_rad, (int)status->jumped,
         (int)status->follows_gyro, status->jumps, status->published, status->thinned, status->withheld);
  return 1;
}

static int print_report(const void* sample) {
  const nilio_msg_dds__ScanReport_* report = sample;
  printf("report %" PRIu64 " [%s] [%s] [%s]", report->scan_sequence, report->state, report->stop_reason,
         report->host_id);
  for (uint32_t i = 0; i < report->stages._length; ++i)
    printf(" [%s=%" PRId64 "]", report->stages._buffer[i].name, report->stages._buffer[i].monotonic_ns);
  printf(" %d %d %u %g %" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32
         " %" PRIu32 " %" PRIu64 " [%s] %d %" PRId64 "\n",
         (int)report->imu_used, (int)report->predicted, (unsigned)report->degenerate_axes,
         (double)report->coverage_deg, report->points, report->points_used, report->correspondences,
         report->coarse_iterations, report->fine_iterations, report->map_voxels, report->lost_packets,
         report->missing_firings, report->superseded, report->degradation_level, (int)report->guarded,
         report->overshoot_ns);
  return 1;
}

static int print_cloud(const void* sample) {
  const sensor_msgs_msg_dds__PointCloud2_* cloud = sample;
  print_header("cloud", &cloud->header, "-");
  printf(" %" PRIu32 " %" PRIu32, cloud->height, cloud->width);
  for (uint32_t i = 0; i < cloud->fields._length; ++i) {
    const sensor_msgs_msg_dds__PointField_* field = &cloud->fields._buffer[i];
    printf(" [%s %" PRIu32 " %u %" PRIu32 "]", field->name, field->offset, (unsigned)field->datatype,
           field->count);
  }
  printf(" %d %" PRIu32 " %" PRIu32 " %d ", (int)cloud->is_bigendian, cloud->point_step, cloud->row_step,
         (int)cloud->is_dense);
  for (uint32_t i = 0; i < cloud->data._length; ++i) printf("%02x", cloud->data._buffer[i]);
  printf("\n");
  return 1;
}

static int print_path(const void* sample) {
  const nav_msgs_msg_dds__Path_* path = sample;
  print_header("path", &path->header, "-");
  for (uint32_t i = 0; i < path->poses._length; ++i) {
    const geometry_msgs_msg_dds__PoseStamped_* stamped = &path->poses._buffer[i];
    const geometry_msgs_msg_dds__Pose_* pose = &stamped->pose;
    print_header(" pose", &stamped->header, "-");
    print_numbers((double[]){pose->position.x, pose->position.y, pose->position.z}, 3);
    print_numbers(
        (double[]){pose->orientation.x, pose->orientation.y, pose->orientation.z, pose->orientation.w}, 4);
  }
  printf("\n");
  return 1;
}

// Prints what has arrived; returns how many samples.
static int drain(dds_entity_t reader, int (*print)(const void*)) {
  int printed = 0;
  void* samples[1] = {NULL};
  dds_sample_info_t info;
  while (dds_take(reader, samples, &info, 1, 1) > 0) {
    if (info.valid_data) printed += print(samples[0]);
    dds_return_loan(reader, samples, 1);
  }
  return printed;
}

static dds_entity_t create_reader(dds_entity_t participant, const dds_topic_descriptor_t* type,
                                  const char* name, dds_reliability_kind_t reliability,
                                  dds_durability_kind_t durability) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, reliability, DDS_SECS(1));
  dds_qset_durability(qos, durability);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1000);
  const dds_entity_t topic = dds_create_topic(participant, type, name, NULL, NULL);
  const dds_entity_t reader = dds_create_reader(participant, topic, qos, NULL);
  dds_delete_qos(qos);
  return reader;
}

static bool is_matched(dds_entity_t reader) {
  dds_subscription_matched_status_t status;
  return dds_get_subscription_matched_status(reader, &status) == DDS_RETCODE_OK && status.current_count > 0;
}

static int64_t monotonic_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

// Called by CycloneDDS's receive thread.
static void on_odometry(dds_entity_t reader, void* count) {
  const int64_t now = monotonic_ns();
  void* samples[1] = {NULL};
  dds_sample_info_t info;
  while (dds_take(reader, samples, &info, 1, 1) > 0) {
    const nav_msgs_msg_dds__Odometry_* odometry = samples[0];
    if (info.valid_data) {
      printf("arrival %" PRId64 " %" PRId32 " %" PRIu32 "\n", now, odometry->header.stamp.sec,
             odometry->header.stamp.nanosec);
      ++*(volatile int*)count;
    }
    dds_return_loan(reader, samples, 1);
  }
  fflush(stdout);
}

static void on_report(dds_entity_t reader, void* unused) {
  (void)unused;
  const int64_t now = monotonic_ns();
  void* samples[1] = {NULL};
  dds_sample_info_t info;
  while (dds_take(reader, samples, &info, 1, 1) > 0) {
    const nilio_msg_dds__ScanReport_* report = samples[0];
    if (info.valid_data) {
      printf("report %" PRId64 " %" PRId32 " %" PRIu32, now, report->stamp.sec, report->stamp.nanosec);
      for (uint32_t i = 0; i < report->stages._length; ++i)
        printf(" %s=%" PRId64, report->stages._buffer[i].name, report->stages._buffer[i].monotonic_ns);
      printf("\n");
    }
    dds_return_loan(reader, samples, 1);
  }
  fflush(stdout);
}

static void on_matched(dds_entity_t reader, const dds_subscription_matched_status_t status, void* unused) {
  (void)reader, (void)unused;
  printf("matched %" PRId64 " %" PRIu32 "\n", monotonic_ns(), status.current_count);
  fflush(stdout);
}

static void on_liveliness(dds_entity_t reader, const dds_liveliness_changed_status_t status, void* unused) {
  (void)reader, (void)unused;
  printf("alive %" PRId64 " %" PRIu32 " %" PRIu32 "\n", monotonic_ns(), status.alive_count,
         status.not_alive_count);
  fflush(stdout);
}

static void on_deadline(dds_entity_t reader, const dds_requested_deadline_missed_status_t status,
                        void* unused) {
  (void)reader, (void)unused;
  printf("deadline %" PRId64 " %" PRIu32 "\n", monotonic_ns(), status.total_count);
  fflush(stdout);
}

static int print_arrivals(dds_domainid_t domain, int wanted, dds_time_t deadline, bool promises) {
  int received = 0;
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
  if (promises) {
    dds_qset_deadline(qos, DDS_MSECS(500));
    dds_qset_liveliness(qos, DDS_LIVELINESS_AUTOMATIC, DDS_SECS(2));
  }
  dds_listener_t* listener = dds_create_listener(&received);
  dds_lset_data_available(listener, on_odometry);
  dds_lset_subscription_matched(listener, on_matched);
  dds_lset_liveliness_changed(listener, on_liveliness);
  dds_lset_requested_deadline_missed(listener, on_deadline);
  const dds_entity_t participant = dds_create_participant(domain, NULL, NULL);
  const dds_entity_t topic =
      dds_create_topic(participant, &nav_msgs_msg_dds__Odometry__desc, "rt/odom", NULL, NULL);
  const dds_entity_t reader = dds_create_reader(participant, topic, qos, listener);
  dds_reset_listener(listener);
  dds_lset_data_available(listener, on_report);
  const dds_entity_t report_topic =
      dds_create_topic(participant, &nilio_msg_dds__ScanReport__desc, "rt/nilio/scan_report", NULL, NULL);
  dds_create_reader(participant, report_topic, qos, listener);
  dds_delete_qos(qos);
  dds_delete_listener(listener);
  if (reader < 0) {
    fprintf(stderr, "CycloneDDS cannot create a reader on domain %d\n", (int)domain);
    return 2;
  }
  printf("waiting %" PRId64 "\n", monotonic_ns());
  fflush(stdout);
  while (*(volatile int*)&received < wanted && dds_time() < deadline) dds_sleepfor(DDS_MSECS(5));
  dds_delete(participant);
  return received < wanted ? 1 : 0;
}

// A topic to read: how many of its messages are wanted, and how they are printed.
typedef struct {
  const char* name;
  const dds_topic_descriptor_t* type;
  dds_reliability_kind_t reliability;
  int (*print)(const void*);
  int wanted;
  int received;
  dds_entity_t reader;
} topic_t;

static bool all_matched(const topic_t* topics, size_t count) {
  for (size_t i = 0; i < count; ++i) {
    if (!is_matched(topics[i].reader)) return false;
  }
  return true;
}

static bool all_received(const topic_t* topics, size_t count) {
  for (size_t i = 0; i < count; ++i) {
    if (topics[i].received < topics[i].wanted) return false;
  }
  return true;
}

int main(int argc, char** argv) {
  const char* const mode = argc == 5 ? argv[4] : "";
  const bool imu = strcmp(mode, "imu") == 0;
  const bool clouds = strcmp(mode, "clouds") == 0;
  const bool map = strcmp(mode, "map") == 0;
  const bool promises = strcmp(mode, "promises") == 0;
  const bool arrivals = promises || strcmp(mode, "arrivals") == 0;
  if (argc != 4 && !imu && !clouds && !map && !arrivals) {
    fprintf(stderr, "usage: %s DOMAIN COUNT TIMEOUT_S [imu|clouds|arrivals|promises]\n", argv[0]);
    return 2;
  }
  const int wanted = atoi(argv[2]);
  const dds_time_t deadline = dds_time() + DDS_SECS(atoi(argv[3]));
  if (arrivals) return print_arrivals((dds_domainid_t)atoi(argv[1]), wanted, deadline, promises);
  const dds_reliability_kind_t reliable = DDS_RELIABILITY_RELIABLE;
  topic_t scans[] = {{"rt/odom", &nav_msgs_msg_dds__Odometry__desc, reliable, print_odometry, wanted, 0, 0},
                     {"rt/tf", &tf2_msgs_msg_dds__TFMessage__desc, reliable, print_transforms, wanted, 0, 0},
                     {"rt/diagnostics", &diagnostic_msgs_msg_dds__DiagnosticArray__desc, reliable,
                      print_diagnostics, 1, 0, 0}};
  topic_t imu_rate[] = {
      {"rt/nilio/odometry_imu", &nav_msgs_msg_dds__Odometry__desc, DDS_RELIABILITY_BEST_EFFORT,
       print_odometry, wanted, 0, 0},
      {"rt/nilio/odometry_imu_status", &nilio_msg_dds__ImuPoseStatus__desc, reliable, print_status, 1, 0, 0},
      {"rt/nilio/scan_report", &nilio_msg_dds__ScanReport__desc, reliable, print_report, 1, 0, 0}};
  topic_t large[] = {
      {"rt/registered_scan", &sensor_msgs_msg_dds__PointCloud2__desc, reliable, print_cloud, wanted, 0, 0},
      {"rt/registered_scan", &sensor_msgs_msg_dds__PointCloud2__desc, DDS_RELIABILITY_BEST_EFFORT,
       print_cloud, wanted, 0, 0},
      {"rt/path", &nav_msgs_msg_dds__Path__desc, reliable, print_path, 1, 0, 0}};
  // The last is not kept for late readers.
  topic_t of_map[] = {
      {"rt/submaps", &sensor_msgs_msg_dds__PointCloud2__desc, reliable, print_cloud, wanted, 0, 0},
      {"rt/submap_poses", &nav_msgs_msg_dds__Path__desc, reliable, print_path, 1, 0, 0},
      {"rt/tf_static", &tf2_msgs_msg_dds__TFMessage__desc, reliable, print_transforms, 1, 0, 0},
      {"rt/nilio/map_corrections", &diagnostic_msgs_msg_dds__DiagnosticArray__desc, reliable,
       print_diagnostics, 1, 0, 0},
      {"rt/local_map", &sensor_msgs_msg_dds__PointCloud2__desc, reliable, print_cloud, 1, 0, 0}};
  topic_t* const topics = imu ? imu_rate : clouds ? large : map ? of_map : scans;
  const size_t count = map ? 5 : 3;
  const dds_entity_t participant = dds_create_participant((dds_domainid_t)atoi(argv[1]), NULL, NULL);
  for (size_t i = 0; i < count; ++i) {
    const dds_durability_kind_t durability =
        map && i < 4 ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE;
    topics[i].reader =
        create_reader(participant, topics[i].type, topics[i].name, topics[i].reliability, durability);
    if (participant < 0 || topics[i].reader < 0) {
      fprintf(stderr, "CycloneDDS cannot create a reader on domain %s\n", argv[1]);
      return 2;
    }
  }
  while (!all_matched(topics, count) && dds_time() < deadline) dds_sleepfor(DDS_MSECS(5));
  printf("ready\n");
  fflush(stdout);
  while (!all_received(topics, count) && dds_time() < deadline) {
    for (size_t i = 0; i < count; ++i) topics[i].received += drain(topics[i].reader, topics[i].print);
    fflush(stdout);
    dds_sleepfor(DDS_MSECS(5));
  }
  dds_delete(participant);
  return all_received(topics, count) ? 0 : 1;
}
