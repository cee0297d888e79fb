// Reads poses and scan reports of nilio-publisher with CycloneDDS, as another vendor's node would, and prints
// when each arrived:
//
//   ready FIFO                           both topics are matched; FIFO: 1 where SCHED_FIFO is permitted
//   pose STAMP_NS ARRIVED_NS             CLOCK_MONOTONIC
//   packet STAMP_NS RECEIVED_NS HOST_ID  the scan's last packet, from its report
//
//   nilio-pose-reader DOMAIN             until it is killed

#include <inttypes.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "dds/dds.h"
#include "nilio.h"

enum { kPriority = 30, kReaders = 2 };

static int64_t monotonic_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static int64_t stamp_ns(const builtin_interfaces_msg_dds__Time_* stamp) {
  return (int64_t)stamp->sec * 1000000000 + stamp->nanosec;
}

static void print_pose(const void* sample) {
  const nav_msgs_msg_dds__Odometry_* odometry = sample;
  printf("pose %" PRId64 " %" PRId64 "\n", stamp_ns(&odometry->header.stamp), monotonic_ns());
}

static void print_packet(const void* sample) {
  const nilio_msg_dds__ScanReport_* report = sample;
  for (uint32_t i = 0; i < report->stages._length; ++i) {
    const nilio_msg_dds__StageStamp_* stage = &report->stages._buffer[i];
    if (strcmp(stage->name, "received") != 0) continue;
    printf("packet %" PRId64 " %" PRId64 " %s\n", stamp_ns(&report->stamp), stage->monotonic_ns,
           report->host_id);
  }
}

static dds_entity_t create_reader(dds_entity_t participant, const dds_topic_descriptor_t* type,
                                  const char* name) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1000);
  const dds_entity_t topic = dds_create_topic(participant, type, name, NULL, NULL);
  const dds_entity_t reader = dds_create_reader(participant, topic, qos, NULL);
  dds_delete_qos(qos);
  if (reader >= 0) dds_set_status_mask(reader, DDS_DATA_AVAILABLE_STATUS);
  return reader;
}

static void drain(dds_entity_t reader, void (*print)(const void*)) {
  void* samples[1] = {NULL};
  dds_sample_info_t info;
  while (dds_take(reader, samples, &info, 1, 1) > 0) {
    if (info.valid_data) print(samples[0]);
    dds_return_loan(reader, samples, 1);
  }
}

static int is_matched(dds_entity_t reader) {
  dds_subscription_matched_status_t status;
  return dds_get_subscription_matched_status(reader, &status) == DDS_RETCODE_OK && status.current_count > 0;
}

int main(int argc, char** argv) {
  if (argc != 2) {
    fprintf(stderr, "usage: %s DOMAIN\n", argv[0]);
    return 2;
  }
  // Before the participant: its threads inherit the priority.
  const struct sched_param parameters = {.sched_priority = kPriority};
  const int fifo = sched_setscheduler(0, SCHED_FIFO, &parameters) == 0;
  setvbuf(stdout, NULL, _IOLBF, 0);
  const dds_entity_t participant = dds_create_participant((dds_domainid_t)atoi(argv[1]), NULL, NULL);
  const dds_entity_t readers[kReaders] = {
      create_reader(participant, &nav_msgs_msg_dds__Odometry__desc, "rt/odom"),
      create_reader(participant, &nilio_msg_dds__ScanReport__desc, "rt/nilio/scan_report")};
  void (*const prints[kReaders])(const void*) = {print_pose, print_packet};
  const dds_entity_t waitset = dds_create_waitset(participant);
  for (int i = 0; i < kReaders; ++i) {
    if (participant < 0 || readers[i] < 0 || dds_waitset_attach(waitset, readers[i], i) != DDS_RETCODE_OK) {
      fprintf(stderr, "CycloneDDS cannot create a reader on domain %s\n", argv[1]);
      return 1;
    }
  }
  for (int ready = 0;;) {
    dds_waitset_wait(waitset, NULL, 0, DDS_MSECS(50));
    for (int i = 0; i < kReaders; ++i) drain(readers[i], prints[i]);
    if (ready || !is_matched(readers[0]) || !is_matched(readers[1])) continue;
    ready = 1;
    printf("ready %d\n", fifo);
  }
}
