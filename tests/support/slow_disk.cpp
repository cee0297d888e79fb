// Preloaded into a program under test: write() to files below $NILIO_SLOW_FOLDER waits as long as the file
// $NILIO_SLOW_WHILE exists, like a disk that does not answer.

#include <array>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <dlfcn.h>
#include <string>
#include <unistd.h>

namespace {

bool is_on_slow_disk(int descriptor) {
  const char* const folder = std::getenv("NILIO_SLOW_FOLDER");
  if (folder == nullptr) return false;
  std::array<char, 4096> path{};
  const std::string link = "/proc/self/fd/" + std::to_string(descriptor);
  const ssize_t size = readlink(link.c_str(), path.data(), path.size() - 1);
  return size > 0 && std::strncmp(path.data(), folder, std::strlen(folder)) == 0;
}

}  // namespace

extern "C" ssize_t write(int descriptor, const void* data, std::size_t size) {
  using Write = ssize_t (*)(int, const void*, std::size_t);
  static const auto real = reinterpret_cast<Write>(dlsym(RTLD_NEXT, "write"));
  const char* const flag = std::getenv("NILIO_SLOW_WHILE");
  if (flag != nullptr && is_on_slow_disk(descriptor)) {
    while (access(flag, F_OK) == 0) {
      const timespec pause{0, 10'000'000};
      nanosleep(&pause, nullptr);
    }
  }
  return real(descriptor, data, size);
}
