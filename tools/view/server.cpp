#include "tools/view/server.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/core/units.hpp"

#include "tools/view/http_request.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <cstring>
#include <libwebsockets.h>
#include <list>
#include <netinet/in.h>
#include <set>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace nilio::tools::view {

namespace {

constexpr unsigned kHeadSeconds = 3;
constexpr std::int64_t kTokenNs = 3'000'000'000;
constexpr std::int64_t kSlowNs = 5'000'000'000;
constexpr std::int64_t kTickUs = 50'000;
constexpr std::size_t kChunk = 32 * 1024;
constexpr std::size_t kMaxToken = 256;
constexpr std::size_t kHeadBytes = 8192;
static_assert(Frame::kRoom >= LWS_PRE);

/// The body of a response on its way. libwebsockets keeps only zeroed bytes for a connection.
struct Transfer {
  std::shared_ptr<const std::string> body;
  std::size_t sent = 0;
};

struct HttpSession {
  Transfer* transfer;
};

struct PageSession {
  PageClient* client;
};

std::string header_of(lws* wsi, lws_token_indexes token) {
  const int length = lws_hdr_total_length(wsi, token);
  if (length <= 0) return {};
  std::string value(static_cast<std::size_t>(length) + 1, '\0');
  const int copied = lws_hdr_copy(wsi, value.data(), static_cast<int>(value.size()), token);
  value.resize(copied > 0 ? static_cast<std::size_t>(copied) : 0);
  return value;
}

/// Tries the address before libwebsockets, for the reason.
core::Result<std::monostate> check_address(const Server::Options& options) {
  const bool v6 = options.address.find(':') != std::string::npos;
  sockaddr_storage storage{};
  socklen_t length = 0;
  if (v6) {
    auto* const address = reinterpret_cast<sockaddr_in6*>(&storage);
    address->sin6_family = AF_INET6;
    address->sin6_port = htons(options.port);
    length = inet_pton(AF_INET6, options.address.c_str(), &address->sin6_addr) == 1 ? sizeof *address : 0;
  } else {
    auto* const address = reinterpret_cast<sockaddr_in*>(&storage);
    address->sin_family = AF_INET;
    address->sin_port = htons(options.port);
    length = inet_pton(AF_INET, options.address.c_str(), &address->sin_addr) == 1 ? sizeof *address : 0;
  }
  if (length == 0) return core::Error{options.address + ": is not an IP address - give one of this computer"};
  const int descriptor = ::socket(storage.ss_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int reuse = 1;
  ::setsockopt(descriptor, SOL_SOCKET, SO_REUSEADDR, &reuse, sizeof reuse);
  const bool bound =
      ::bind(descriptor, reinterpret_cast<sockaddr*>(&storage), length) == 0 && ::listen(descriptor, 1) == 0;
  const int error = errno;
  ::close(descriptor);
  if (bound) return std::monostate{};
  const std::string where = options.address + " port " + std::to_string(options.port);
  if (error == EADDRINUSE)
    return core::Error{where +
                       ": in use, perhaps by another nilio view - choose another --port (0: any free one)"};
  if (error == EADDRNOTAVAIL)
    return core::Error{where + ": not an address of this computer - see 'ip address'"};
  return core::Error{where + ": cannot be used (" + std::strerror(error) + ")"};
}

}  // namespace

void PageClient::send(const std::shared_ptr<const std::string>& text) {
  if (waiting_ + text->size() > kMaxWaiting && !texts_.empty()) {
    overflowed_ = true;
    return;
  }
  waiting_ += text->size();
  texts_.push_back(
      std::make_shared<Frame>(std::span(reinterpret_cast<const std::uint8_t*>(text->data()), text->size())));
}

struct Server::Implementation {
  Implementation(const Options& options, Content& content) : options_(options), content_(content) {}
  ~Implementation() {
    if (context_ != nullptr) lws_context_destroy(context_);
  }
  Implementation(const Implementation&) = delete;
  Implementation& operator=(const Implementation&) = delete;

  bool create();
  void tick();

  static Implementation& of(lws* wsi) {
    return *static_cast<Implementation*>(lws_context_user(lws_get_context(wsi)));
  }
  static int on_http(lws* wsi, lws_callback_reasons reason, void* user, void* in, std::size_t length);
  static int on_page(lws* wsi, lws_callback_reasons reason, void* user, void* in, std::size_t length);

  int begin_response(lws* wsi, HttpSession& session, std::string_view path);
  int respond(lws* wsi, HttpSession& session, unsigned status, const Response& response, bool head);
  int refuse(lws* wsi, unsigned status, const char* text);
  int continue_response(lws* wsi, HttpSession& session);
  [[nodiscard]] bool is_host_allowed(lws* wsi) const;
  [[nodiscard]] bool is_origin_allowed(lws* wsi) const;

  int open_page(lws* wsi, PageSession& session);
  int receive(PageClient& client, std::string_view text);
  int write_next(lws* wsi, PageClient& client);
  void ask_for_room(lws* wsi, PageClient& client, std::int64_t now) const;
  void admit_socket(lws* wsi);

  Options options_;
  Content& content_;
  ServerCounts counts_;
  lws_context* context_ = nullptr;
  std::uint16_t port_ = 0;
  std::map<lws*, std::unique_ptr<PageClient>> pages_;
  std::list<lws*> without_request_;  ///< oldest first
  std::int64_t next_tick_ns_ = 0;
};

namespace {

/// Asked for by name in the page.
constexpr const char* kPageProtocol = "nilio-view";

}  // namespace

bool Server::Implementation::create() {
  static const std::array<lws_protocols, 3> kProtocols{
      lws_protocols{"http", &Implementation::on_http, sizeof(HttpSession), 0, 0, nullptr, 0},
      lws_protocols{kPageProtocol, &Implementation::on_page, sizeof(PageSession), 1024, 0, nullptr, 0},
      lws_protocols{nullptr, nullptr, 0, 0, 0, nullptr, 0}};
  lws_set_log_level(0, nullptr);
  lws_context_creation_info info{};
  info.port = options_.port;
  info.iface = options_.address.c_str();
  info.protocols = kProtocols.data();
  info.user = this;
  info.gid = static_cast<gid_t>(-1);
  info.uid = static_cast<uid_t>(-1);
  info.options = LWS_SERVER_OPTION_FAIL_UPON_UNABLE_TO_BIND | LWS_SERVER_OPTION_DISABLE_IPV6;
  if (options_.address.find(':') != std::string::npos)
    info.options &= ~static_cast<decltype(info.options)>(LWS_SERVER_OPTION_DISABLE_IPV6);
  info.max_http_header_data = kHeadBytes;
  info.max_http_header_pool = kMaxSockets;
  info.fd_limit_per_thread = kMaxSockets;
  info.timeout_secs = kHeadSeconds;
  info.timeout_secs_ah_idle = kHeadSeconds;
  info.keepalive_timeout = 1;
  info.server_string = "nilio";
  info.pt_serv_buf_size = kChunk;
  context_ = lws_create_context(&info);
  if (context_ == nullptr) return false;
  port_ = static_cast<std::uint16_t>(lws_get_vhost_listen_port(lws_get_vhost_by_name(context_, "default")));
  return true;
}

void Server::Implementation::admit_socket(lws* wsi) {
  without_request_.push_back(wsi);
  if (without_request_.size() <= kMaxWithoutRequest) return;
  lws_set_timeout(without_request_.front(), PENDING_TIMEOUT_USER_OK, LWS_TO_KILL_ASYNC);
  without_request_.pop_front();
  ++counts_.slow_clients;
}

int Server::Implementation::on_http(lws* wsi, lws_callback_reasons reason, void* user, void* in,
                                    std::size_t length) {
  auto* const session = static_cast<HttpSession*>(user);
  switch (reason) {
    case LWS_CALLBACK_SERVER_NEW_CLIENT_INSTANTIATED:
      of(wsi).admit_socket(wsi);
      return 0;
    case LWS_CALLBACK_WSI_DESTROY:
      of(wsi).without_request_.remove(wsi);
      return 0;
    case LWS_CALLBACK_HTTP:
      of(wsi).without_request_.remove(wsi);
      return of(wsi).begin_response(wsi, *session, {static_cast<const char*>(in), length});
    case LWS_CALLBACK_HTTP_WRITEABLE:
      return session != nullptr && session->transfer != nullptr ? of(wsi).continue_response(wsi, *session)
                                                                : -1;
    case LWS_CALLBACK_CLOSED_HTTP:
    case LWS_CALLBACK_HTTP_DROP_PROTOCOL:
      if (session != nullptr) delete std::exchange(session->transfer, nullptr);
      return 0;
    default:
      return 0;
  }
}

bool Server::Implementation::is_host_allowed(lws* wsi) const {
  // A token is more than a web page elsewhere could know.
  if (!options_.token.empty()) return true;
  const std::string host = host_name(header_of(wsi, WSI_TOKEN_HOST));
  return host == "localhost" || host == options_.address || is_loopback(host);
}

bool Server::Implementation::is_origin_allowed(lws* wsi) const {
  const std::string origin = header_of(wsi, WSI_TOKEN_ORIGIN);
  if (origin.empty()) return true;
  const std::size_t scheme = origin.find("://");
  return scheme != std::string::npos && origin.substr(scheme + 3) == header_of(wsi, WSI_TOKEN_HOST);
}

int Server::Implementation::refuse(lws* wsi, unsigned status, const char* text) {
  ++counts_.refused;
  lws_return_http_status(wsi, status, text);
  return -1;
}

int Server::Implementation::begin_response(lws* wsi, HttpSession& session, std::string_view path) {
  ++counts_.requests;
  const bool head = lws_hdr_total_length(wsi, WSI_TOKEN_HEAD_URI) > 0;
  if (!head && lws_hdr_total_length(wsi, WSI_TOKEN_GET_URI) <= 0)
    return refuse(wsi, HTTP_STATUS_METHOD_NOT_ALLOWED, "GET and HEAD only");
  if (!is_host_allowed(wsi)) return refuse(wsi, HTTP_STATUS_FORBIDDEN, "this host name is not served");
  if (!is_plain_path(path)) return refuse(wsi, HTTP_STATUS_NOT_FOUND, "not found");
  // The page itself holds no data.
  if (!options_.token.empty() && path != "/" &&
      !is_bearer(header_of(wsi, WSI_TOKEN_HTTP_AUTHORIZATION), options_.token))
    return refuse(wsi, HTTP_STATUS_UNAUTHORIZED, "a token is needed: Authorization: Bearer TOKEN");
  const std::optional<Response> response = content_.get(path, header_of(wsi, WSI_TOKEN_HTTP_ACCEPT));
  if (!response) return refuse(wsi, HTTP_STATUS_NOT_FOUND, "not found");
  return respond(wsi, session, HTTP_STATUS_OK, *response, head);
}

int Server::Implementation::respond(lws* wsi, HttpSession& session, unsigned status, const Response& response,
                                    bool head) {
  std::array<unsigned char, LWS_PRE + 2048> buffer{};
  unsigned char* const start = buffer.data() + LWS_PRE;
  unsigned char* at = start;
  unsigned char* const end = buffer.data() + buffer.size() - 1;
  std::shared_ptr<const std::string> body = response.body;
  const bool accepts_gzip = header_of(wsi, WSI_TOKEN_HTTP_ACCEPT_ENCODING).find("gzip") != std::string::npos;
  if (response.gzip && !accepts_gzip) {
    auto inflated = gunzip(*body);
    if (!inflated) return refuse(wsi, HTTP_STATUS_INTERNAL_SERVER_ERROR, "cannot be decompressed");
    body = std::make_shared<const std::string>(std::move(inflated).value());
  }
  const auto add = [&](const char* name, std::string_view value) {
    return lws_add_http_header_by_name(wsi, reinterpret_cast<const unsigned char*>(name),
                                       reinterpret_cast<const unsigned char*>(value.data()),
                                       static_cast<int>(value.size()), &at, end) == 0;
  };
  bool good =
      lws_add_http_common_headers(wsi, status, response.content_type.c_str(), body->size(), &at, end) == 0 &&
      add("cache-control:", "no-store") && add("x-content-type-options:", "nosniff") &&
      add("referrer-policy:", "no-referrer") && add("cross-origin-resource-policy:", "same-origin");
  if (response.gzip && accepts_gzip)
    good = good && add("content-encoding:", "gzip") && add("vary:", "accept-encoding");
  if (!response.security_policy.empty())
    good = good && add("content-security-policy:", response.security_policy);
  if (!good || lws_finalize_write_http_header(wsi, start, &at, end) != 0) return -1;
  if (head) return lws_http_transaction_completed(wsi) != 0 ? -1 : 0;
  delete std::exchange(session.transfer, new Transfer{body, 0});
  lws_callback_on_writable(wsi);
  return 0;
}

int Server::Implementation::continue_response(lws* wsi, HttpSession& session) {
  Transfer& transfer = *session.transfer;
  const std::size_t size = std::min(kChunk, transfer.body->size() - transfer.sent);
  std::vector<unsigned char> chunk(LWS_PRE + size);
  std::memcpy(chunk.data() + LWS_PRE, transfer.body->data() + transfer.sent, size);
  transfer.sent += size;
  const bool last = transfer.sent == transfer.body->size();
  counts_.bytes_sent += size;
  // The client has to take every part within this time.
  lws_set_timeout(wsi, PENDING_TIMEOUT_HTTP_CONTENT, static_cast<int>(kSlowNs / kNanosecondsPerSecond));
  if (lws_write(wsi, chunk.data() + LWS_PRE, size, last ? LWS_WRITE_HTTP_FINAL : LWS_WRITE_HTTP) < 0)
    return -1;
  if (!last) {
    lws_callback_on_writable(wsi);
    return 0;
  }
  delete std::exchange(session.transfer, nullptr);
  return lws_http_transaction_completed(wsi) != 0 ? -1 : 0;
}

int Server::Implementation::open_page(lws* wsi, PageSession& session) {
  if (pages_.size() >= kMaxClients) {
    ++counts_.refused;
    std::string reason = "all places are taken";
    lws_close_reason(wsi, static_cast<lws_close_status>(1013),
                     reinterpret_cast<unsigned char*>(reason.data()), reason.size());
    return -1;
  }
  auto client = std::make_unique<PageClient>();
  client->since_ns_ = monotonic_ns();
  client->admitted_ = options_.token.empty();
  session.client = client.get();
  pages_[wsi] = std::move(client);
  counts_.clients = pages_.size();
  return 0;
}

int Server::Implementation::receive(PageClient& client, std::string_view text) {
  // The page says nothing but its token.
  if (text.size() > kMaxToken) return -1;
  if (client.admitted_) return 0;
  if (!equals_in_constant_time(text, options_.token)) {
    ++counts_.refused;
    return -1;
  }
  client.admitted_ = true;
  return 0;
}

int Server::Implementation::write_next(lws* wsi, PageClient& client) {
  client.writable_asked_ns_ = 0;
  if (!client.admitted_) return 0;
  FramePtr frame;
  bool is_text = false;
  if (!client.texts_.empty()) {
    frame = std::move(client.texts_.front());
    client.texts_.pop_front();
    client.waiting_ -= std::min(client.waiting_, frame->size());
    is_text = true;
  } else {
    frame = content_.next_frame(client);
  }
  if (!frame) return 0;
  const int written =
      lws_write(wsi, frame->content(), frame->size(), is_text ? LWS_WRITE_TEXT : LWS_WRITE_BINARY);
  if (written < static_cast<int>(frame->size())) return -1;
  ++counts_.frames_sent;
  counts_.bytes_sent += frame->size();
  ask_for_room(wsi, client, monotonic_ns());
  return 0;
}

void Server::Implementation::ask_for_room(lws* wsi, PageClient& client, std::int64_t now) const {
  if (client.writable_asked_ns_ == 0) client.writable_asked_ns_ = now;
  lws_callback_on_writable(wsi);
}

int Server::Implementation::on_page(lws* wsi, lws_callback_reasons reason, void* user, void* in,
                                    std::size_t length) {
  auto* const session = static_cast<PageSession*>(user);
  switch (reason) {
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION:
      of(wsi).without_request_.remove(wsi);
      if (of(wsi).is_host_allowed(wsi) && of(wsi).is_origin_allowed(wsi)) return 0;
      ++of(wsi).counts_.refused;
      return -1;
    case LWS_CALLBACK_ESTABLISHED:
      return of(wsi).open_page(wsi, *session);
    case LWS_CALLBACK_RECEIVE:
      return session->client == nullptr
                 ? -1
                 : of(wsi).receive(*session->client, {static_cast<const char*>(in), length});
    case LWS_CALLBACK_SERVER_WRITEABLE:
      return session->client == nullptr ? -1 : of(wsi).write_next(wsi, *session->client);
    case LWS_CALLBACK_CLOSED:
      of(wsi).pages_.erase(wsi);
      of(wsi).counts_.clients = of(wsi).pages_.size();
      return 0;
    case LWS_CALLBACK_WSI_DESTROY:
      of(wsi).without_request_.remove(wsi);
      return 0;
    default:
      return 0;
  }
}

void Server::Implementation::tick() {
  const std::int64_t now = monotonic_ns();
  std::vector<PageClient*> clients;
  for (const auto& [wsi, client] : pages_) {
    if (client->admitted_) clients.push_back(client.get());
  }
  content_.tick(clients);
  for (const auto& [wsi, client] : pages_) {
    const bool is_slow = client->writable_asked_ns_ != 0 && now - client->writable_asked_ns_ > kSlowNs;
    const bool is_silent = !client->admitted_ && now - client->since_ns_ > kTokenNs;
    if (is_slow || is_silent || client->overflowed_) {
      ++counts_.slow_clients;
      lws_set_timeout(wsi, PENDING_TIMEOUT_USER_OK, LWS_TO_KILL_ASYNC);
      continue;
    }
    if (client->admitted_) ask_for_room(wsi, *client, now);
  }
}

bool is_loopback(const std::string& address) { return address.starts_with("127.") || address == "::1"; }

Server::Server(std::unique_ptr<Implementation> implementation) : implementation_(std::move(implementation)) {}
Server::~Server() = default;

core::Result<std::unique_ptr<Server>> Server::create(const Options& options, Content& content) {
  if (const auto checked = check_address(options); !checked) return checked.error();
  auto implementation = std::make_unique<Implementation>(options, content);
  if (!implementation->create())
    return core::Error{options.address + " port " + std::to_string(options.port) +
                       ": the server cannot be started - choose another --port"};
  return std::unique_ptr<Server>(new Server(std::move(implementation)));
}

std::uint16_t Server::port() const { return implementation_->port_; }
const ServerCounts& Server::counts() const { return implementation_->counts_; }

void Server::run(const std::function<bool()>& stop) {
  struct Timer {
    lws_sorted_usec_list_t list{};
    Implementation* server = nullptr;
  };
  Timer timer;
  timer.server = implementation_.get();
  const auto on_time = [](lws_sorted_usec_list_t* list) {
    auto* const self = reinterpret_cast<Timer*>(list);
    self->server->tick();
    lws_sul_schedule(self->server->context_, 0, list, list->cb, kTickUs);
  };
  lws_sul_schedule(implementation_->context_, 0, &timer.list, on_time, 1);
  while (!stop()) {
    if (lws_service(implementation_->context_, 0) < 0) break;
  }
  lws_sul_schedule(implementation_->context_, 0, &timer.list, on_time, LWS_SET_TIMER_USEC_CANCEL);
}

}  // namespace nilio::tools::view
