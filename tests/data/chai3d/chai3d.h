// The part of CHAI3D 3 that the bridge calls, with one device: a heavy damper that moves as it is pushed.
#pragma once

#include <chrono>
#include <memory>
#include <string>

namespace chai3d {

class cVector3d {
 public:
  cVector3d(double x = 0, double y = 0, double z = 0) : values_{x, y, z} {}
  double get(unsigned axis) const { return values_[axis]; }
  void set(unsigned axis, double value) { values_[axis] = value; }

 private:
  double values_[3];
};

struct cHapticDeviceInfo {
  std::string m_modelName = "stub";
  double m_maxLinearForce = 8;
  double m_maxLinearStiffness = 3000;
  double m_workspaceRadius = 0.04;
};

class cGenericHapticDevice {
 public:
  virtual ~cGenericHapticDevice() = default;
  cHapticDeviceInfo getSpecifications() { return {}; }
  bool open() { return true; }
  bool calibrate(bool = false) { return true; }
  bool close() { return true; }

  bool getPosition(cVector3d &place) {
    advance();
    place = place_;
    return true;
  }

  bool setForce(const cVector3d &force) {
    advance();
    force_ = force;
    return true;
  }

 private:
  using Clock = std::chrono::steady_clock;

  void advance() {
    const auto now = Clock::now();
    const double t = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    for (unsigned axis = 0; axis < 3; axis++) {
      // A heavy damper: the speed is the force over 20 N·s/m.
      const double to = place_.get(axis) + t * force_.get(axis) / 20.0;
      place_.set(axis, to > 0.04 ? 0.04 : to < -0.04 ? -0.04 : to);
    }
  }

  cVector3d place_, force_;
  Clock::time_point last_ = Clock::now();
};

using cGenericHapticDevicePtr = std::shared_ptr<cGenericHapticDevice>;

class cHapticDeviceHandler {
 public:
  unsigned getNumDevices() { return 1; }
  bool getDevice(cGenericHapticDevicePtr &device, unsigned) {
    device = std::make_shared<cGenericHapticDevice>();
    return true;
  }
};

}  // namespace chai3d
