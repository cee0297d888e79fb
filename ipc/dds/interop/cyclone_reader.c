// Reads odometry, the transform and diagnostics with CycloneDDS, from code that idlc generates from our IDL,
// and prints each field of what it receives on one line, floating-point numbers in hexadecimal so that
// nothing is lost.
//
//   nilio-cyclone-reader DOMAIN COUNT TIMEOUT_S
//
// Ends after COUNT poses and transforms and one array of diagnostics (status 0) or after TIMEOUT_S (status
// 1).

#include "dds/dds.h"
#include "nilio.h"

#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

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
                                  const char* name) {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
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

int main(int argc, char** argv) {
  if (argc != 4) {
    fprintf(stderr, "usage: %s DOMAIN COUNT TIMEOUT_S\n", argv[0]);
    return 2;
  }
  const int wanted = atoi(argv[2]);
  const dds_time_t deadline = dds_time() + DDS_SECS(atoi(argv[3]));
  const dds_entity_t participant = dds_create_participant((dds_domainid_t)atoi(argv[1]), NULL, NULL);
  const dds_entity_t odometry = create_reader(participant, &nav_msgs_msg_dds__Odometry__desc, "rt/odom");
  const dds_entity_t transforms = create_reader(participant, &tf2_msgs_msg_dds__TFMessage__desc, "rt/tf");
  const dds_entity_t diagnostics =
      create_reader(participant, &diagnostic_msgs_msg_dds__DiagnosticArray__desc, "rt/diagnostics");
  if (participant < 0 || odometry < 0 || transforms < 0 || diagnostics < 0) {
    fprintf(stderr, "CycloneDDS cannot create a reader on domain %s\n", argv[1]);
    return 2;
  }
  while (!(is_matched(odometry) && is_matched(transforms) && is_matched(diagnostics)) &&
         dds_time() < deadline)
    dds_sleepfor(DDS_MSECS(5));
  printf("ready\n");
  fflush(stdout);
  int odometries = 0;
  int transform_messages = 0;
  int diagnostic_messages = 0;
  while ((odometries < wanted || transform_messages < wanted || diagnostic_messages < 1) &&
         dds_time() < deadline) {
    odometries += drain(odometry, print_odometry);
    transform_messages += drain(transforms, print_transforms);
    diagnostic_messages += drain(diagnostics, print_diagnostics);
    fflush(stdout);
    dds_sleepfor(DDS_MSECS(5));
  }
  dds_delete(participant);
  return odometries >= wanted && transform_messages >= wanted && diagnostic_messages >= 1 ? 0 : 1;
}
