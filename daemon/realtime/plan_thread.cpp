#include "daemon/realtime/plan_thread.hpp"

#include "daemon/realtime/thread_plan.hpp"
#include "ipc/kernel_requests.hpp"

#include <system_error>
#include <utility>

namespace nilio::daemon {

PlanThread::PlanThread(std::function<void()> body)
    : body_(std::make_unique<std::function<void()>>(std::move(body))) {
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, ipc::kThreadStackBytes);
  const auto run = [](void* data) -> void* {
    (*static_cast<std::function<void()>*>(data))();
    return nullptr;
  };
  const int error = pthread_create(&thread_, &attributes, run, body_.get());
  pthread_attr_destroy(&attributes);
  if (error != 0) throw std::system_error(error, std::generic_category(), "a thread cannot be started");
}

void PlanThread::join() { pthread_join(thread_, nullptr); }

}  // namespace nilio::daemon
