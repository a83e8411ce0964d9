// A haptic device that CHAI3D 3 opens (delta, omega, sigma, Falcon, Touch) as an open frame (docs/open-frame.md).
//
//     g++ -std=c++17 -O2 chai3d_bridge.cpp -I CHAI3D/src -L CHAI3D/lib -lchai3d -o chai3d_bridge
//     ./chai3d_bridge --axes z --port 9999
//     ergon duet fader --live remi=frame+udp://127.0.0.1:9999
//
// Each letter of --axes is an axis of the frame, in this order: x towards the operator, y to the right, z up, as CHAI3D
// has them. All forces end 50 ms after the last request that pushes, and when the program ends.

#include "chai3d.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace {

using Bytes = std::vector<uint8_t>;
using Clock = std::chrono::steady_clock;

constexpr uint8_t FLAG_ENABLE = 1, FLAG_ASK = 2;
constexpr uint8_t STATUS_TOUCHED = 1, STATUS_ENABLED = 2, STATUS_LET_GO = 8;
constexpr uint8_t WIDE = 0x80;
constexpr size_t HEAD = 5;                                 // bytes before the forces of a request
constexpr auto SILENCE = std::chrono::milliseconds(50);    // then the motors let go
constexpr double STEP = 1e-8;                              // of a position [m]
constexpr float EXCHANGES = 1000;                          // a second

volatile std::sig_atomic_t is_over = 0;

void end(int) { is_over = 1; }

uint16_t crc(const uint8_t *bytes, size_t n) {             // CRC-16/CCITT-FALSE
  uint16_t sum = 0xFFFF;
  while (n--) {
    sum ^= static_cast<uint16_t>(*bytes++ << 8);
    for (int bit = 0; bit < 8; bit++) sum = static_cast<uint16_t>(sum & 0x8000 ? (sum << 1) ^ 0x1021 : sum << 1);
  }
  return sum;
}

template <typename Number>
void put(Bytes &bytes, Number number) {                    // this program runs on little-endian machines
  const auto *first = reinterpret_cast<const uint8_t *>(&number);
  bytes.insert(bytes.end(), first, first + sizeof number);
}

template <typename Number>
Number get(const uint8_t *bytes) {
  Number number;
  std::memcpy(&number, bytes, sizeof number);
  return number;
}

// The device and the axes of it that are keys.
class Keys {
 public:
  Keys(chai3d::cGenericHapticDevicePtr device, std::string axes, double force_max)
      : device_(std::move(device)), axes_(std::move(axes)), info_(device_->getSpecifications()) {
    force_max_ = force_max > 0 ? std::min(force_max, info_.m_maxLinearForce) : info_.m_maxLinearForce;
  }

  size_t n() const { return axes_.size(); }
  double force_max() const { return force_max_; }
  double radius() const { return info_.m_workspaceRadius; }
  const std::string &name() const { return info_.m_modelName; }

  std::vector<double> positions() {
    chai3d::cVector3d place;
    device_->getPosition(place);
    std::vector<double> found;
    for (char axis : axes_) found.push_back(place.get(static_cast<unsigned>(axis - 'x')));
    return found;
  }

  void push(const std::vector<double> &newtons) {
    chai3d::cVector3d force(0, 0, 0);
    for (size_t i = 0; i < newtons.size(); i++) {
      // A number that is none pushes nothing.
      const double finite = std::isfinite(newtons[i]) ? newtons[i] : 0.0;
      force.set(static_cast<unsigned>(axes_[i] - 'x'), std::clamp(finite, -force_max_, force_max_));
    }
    device_->setForce(force);
  }

  void release() { push(std::vector<double>(n(), 0.0)); }

 private:
  chai3d::cGenericHapticDevicePtr device_;
  std::string axes_;
  chai3d::cHapticDeviceInfo info_;
  double force_max_;
};

struct Request {
  uint16_t number;
  uint8_t n;                                               // axes; 0 asks who is there
  uint8_t flags;
  std::vector<double> forces;                              // as parts of the greatest force
};

// The request in a datagram; false if it is none for `n` axes.
bool parse(const uint8_t *bytes, size_t length, size_t n, Request &request) {
  if (length < HEAD + 3 || bytes[0] != 0xA5 || bytes[1] != 0x5A) return false;
  request.n = bytes[4];
  if (request.n & WIDE || (request.n != 0 && request.n != n)) return false;
  const size_t whole = HEAD + 2 * request.n + 3;
  if (length != whole || get<uint16_t>(bytes + whole - 2) != crc(bytes + 2, whole - 4)) return false;
  request.number = get<uint16_t>(bytes + 2);
  request.flags = bytes[whole - 3];
  request.forces.clear();
  for (size_t i = 0; i < request.n; i++) request.forces.push_back(get<int16_t>(bytes + HEAD + 2 * i) / 32767.0);
  return true;
}

void finish(Bytes &bytes) { put(bytes, crc(bytes.data() + 2, bytes.size() - 2)); }

// Answers requests. Who pushes owns the device until it lets go, or is silent for 50 ms.
class Board {
 public:
  explicit Board(Keys &keys) : keys_(keys) {}

  // The reply to a datagram of `sender`; empty if there is none.
  Bytes answer(const uint8_t *bytes, size_t length, const std::string &sender) {
    Request request{};
    if (!parse(bytes, length, keys_.n(), request)) return {};
    if (!owner_.empty() && sender != owner_) return {};
    if (request.n == 0) return who(request.number);
    const uint8_t silence = let_go_ ? STATUS_LET_GO : 0;
    if (!(request.flags & FLAG_ASK)) {
      is_enabled_ = request.flags & FLAG_ENABLE;
      owner_ = is_enabled_ ? sender : "";
      heard_ = Clock::now();
      let_go_ = false;
      std::vector<double> newtons(keys_.n(), 0.0);
      for (size_t i = 0; is_enabled_ && i < newtons.size(); i++) newtons[i] = request.forces[i] * keys_.force_max();
      keys_.push(newtons);
    }
    return where(request.number, silence | STATUS_TOUCHED | (is_enabled_ ? STATUS_ENABLED : 0));
  }

  void watch() {
    if (let_go_ || Clock::now() - heard_ <= SILENCE) return;
    keys_.release();
    let_go_ = true;
    is_enabled_ = false;
    owner_.clear();
  }

 private:
  Bytes where(uint16_t number, uint8_t status) {
    const auto since = Clock::now().time_since_epoch();
    Bytes reply{0xA5, 0x5A};
    put(reply, number);
    put(reply, static_cast<uint32_t>(std::chrono::duration_cast<std::chrono::microseconds>(since).count()));
    put(reply, static_cast<uint8_t>(keys_.n()));
    for (double x : keys_.positions()) put(reply, static_cast<int32_t>(std::lround(x / STEP)));
    put(reply, status);
    finish(reply);
    return reply;
  }

  Bytes who(uint16_t number) {
    const auto force = static_cast<float>(keys_.force_max()), radius = static_cast<float>(keys_.radius());
    Bytes reply{0xA5, 0x5D};
    put(reply, number);
    put(reply, static_cast<uint8_t>(keys_.n()));
    put(reply, uint8_t{0});                                // metres, always a finger there, real time
    // Step, mass and friction are not known to CHAI3D.
    for (float number : std::array<float, 8>{force, force, 0, -radius, radius, EXCHANGES, 0, 0}) put(reply, number);
    finish(reply);
    return reply;
  }

  Keys &keys_;
  std::string owner_;
  Clock::time_point heard_{};
  bool let_go_ = true;
  bool is_enabled_ = false;
};

int serve(Keys &keys, const char *address, int port) {
  const int socket_ = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in here{};
  here.sin_family = AF_INET;
  here.sin_port = htons(static_cast<uint16_t>(port));
  if (inet_pton(AF_INET, address, &here.sin_addr) != 1 ||
      bind(socket_, reinterpret_cast<sockaddr *>(&here), sizeof here) != 0) {
    std::fprintf(stderr, "%s:%d cannot be opened: %s\n", address, port, std::strerror(errno));
    return 1;
  }
  socklen_t size = sizeof here;
  getsockname(socket_, reinterpret_cast<sockaddr *>(&here), &size);
  std::printf("%s: %zu axes at frame+udp://%s:%d, up to %g N\n", keys.name().c_str(), keys.n(), address,
              ntohs(here.sin_port), keys.force_max());
  std::fflush(stdout);
  Board board(keys);
  uint8_t bytes[256];
  while (!is_over) {
    pollfd wait{socket_, POLLIN, 0};
    if (poll(&wait, 1, 5) > 0) {
      sockaddr_in sender{};
      size = sizeof sender;
      const ssize_t n = recvfrom(socket_, bytes, sizeof bytes, 0, reinterpret_cast<sockaddr *>(&sender), &size);
      const std::string name(reinterpret_cast<const char *>(&sender), size);
      const Bytes reply = n > 0 ? board.answer(bytes, static_cast<size_t>(n), name) : Bytes{};
      if (!reply.empty()) sendto(socket_, reply.data(), reply.size(), 0, reinterpret_cast<sockaddr *>(&sender), size);
    }
    board.watch();
  }
  keys.release();
  close(socket_);
  return 0;
}

}  // namespace

int main(int count, char **words) {
  std::string axes = "z", address = "127.0.0.1";
  int port = 9999;
  unsigned number = 0;
  double force_max = 0;
  for (int i = 1; i < count; i += 2) {
    const std::string option = words[i];
    const char *value = i + 1 < count ? words[i + 1] : "";
    if (option == "--axes") axes = value;
    else if (option == "--at") address = value;
    else if (option == "--port") port = std::atoi(value);
    else if (option == "--device") number = static_cast<unsigned>(std::atoi(value));
    else if (option == "--force-max") force_max = std::atof(value);
    else axes.clear();
  }
  if (axes.empty() || axes.size() > 3 || axes.find_first_not_of("xyz") != std::string::npos) {
    std::fprintf(stderr, "usage: chai3d_bridge [--axes xyz] [--at 127.0.0.1] [--port 9999] [--device 0] [--force-max N]\n");
    return 2;
  }
  chai3d::cHapticDeviceHandler handler;
  chai3d::cGenericHapticDevicePtr device;
  if (number >= handler.getNumDevices() || !handler.getDevice(device, number) || !device->open()) {
    std::fprintf(stderr, "CHAI3D opens no device %u\n", number);
    return 3;
  }
  device->calibrate();
  std::signal(SIGINT, end);
  std::signal(SIGTERM, end);
  Keys keys(device, axes, force_max);
  const int code = serve(keys, address.c_str(), port);
  device->close();
  return code;
}
