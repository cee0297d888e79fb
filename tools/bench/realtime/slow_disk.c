// Makes the disk of a folder slow or full for the program that this library is preloaded into. Applies to
// regular files below NILIO_DISK_FOLDER, except standard output and error:
//
//   NILIO_DISK_WRITE_MS      every write and sync takes that long
//   NILIO_DISK_STOPPED_FILE  while this file exists no write ends
//   NILIO_DISK_FULL_FILE     while this file exists every write fails: no space left

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

static const char* folder;
static double write_s;
static const char* full_file;
static const char* stopped_file;

__attribute__((constructor)) static void read_environment(void) {
  const char* milliseconds = getenv("NILIO_DISK_WRITE_MS");
  if (milliseconds != NULL) write_s = 1e-3 * atof(milliseconds);
  full_file = getenv("NILIO_DISK_FULL_FILE");
  stopped_file = getenv("NILIO_DISK_STOPPED_FILE");
  folder = getenv("NILIO_DISK_FOLDER");
}

static int is_on_disk(int descriptor) {
  struct stat info;
  if (folder == NULL || descriptor <= STDERR_FILENO || fstat(descriptor, &info) != 0 ||
      !S_ISREG(info.st_mode))
    return 0;
  char link[32] = "/proc/self/fd/";
  char digits[12];
  int count = 0;
  for (int rest = descriptor; rest > 0; rest /= 10) digits[count++] = (char)('0' + rest % 10);
  size_t at = strlen(link);
  while (count > 0) link[at++] = digits[--count];
  link[at] = '\0';
  char path[4096];
  const ssize_t length = readlink(link, path, sizeof path - 1);
  const size_t prefix = strlen(folder);
  return length > (ssize_t)prefix && memcmp(path, folder, prefix) == 0 && path[prefix] == '/';
}

// Waits as the disk does; 0 when the disk is full.
static int disk_accepts(int descriptor) {
  if (!is_on_disk(descriptor)) return 1;
  if (full_file != NULL && access(full_file, F_OK) == 0) {
    errno = ENOSPC;
    return 0;
  }
  while (stopped_file != NULL && access(stopped_file, F_OK) == 0) {
    const struct timespec pause = {0, 10000000};
    nanosleep(&pause, NULL);
  }
  if (write_s > 0.0) {
    const struct timespec pause = {(time_t)write_s, (long)(1e9 * (write_s - (double)(time_t)write_s))};
    nanosleep(&pause, NULL);
  }
  return 1;
}

ssize_t write(int descriptor, const void* bytes, size_t count) {
  return disk_accepts(descriptor) ? syscall(SYS_write, descriptor, bytes, count) : -1;
}

ssize_t writev(int descriptor, const struct iovec* parts, int count) {
  return disk_accepts(descriptor) ? syscall(SYS_writev, descriptor, parts, count) : -1;
}

ssize_t pwrite(int descriptor, const void* bytes, size_t count, off_t offset) {
  return disk_accepts(descriptor) ? syscall(SYS_pwrite64, descriptor, bytes, count, offset) : -1;
}

int fsync(int descriptor) { return disk_accepts(descriptor) ? (int)syscall(SYS_fsync, descriptor) : -1; }

int fdatasync(int descriptor) {
  return disk_accepts(descriptor) ? (int)syscall(SYS_fdatasync, descriptor) : -1;
}
