// The open frame (docs/open-frame.md) on a Teensy 4 or an RP2040: motor faders on full bridges.
//
// Fit the numbers below to your board. Without a motor connected first: move the fader, look at positions.
// A positive force must move the fader towards positive positions; if it does not, swap the motor's wires.

#include <Arduino.h>
#include <math.h>
#include <string.h>

// --- the board ----------------------------------------------------------------------------------

const uint8_t N = 1;                       // axes, at most 16
const uint8_t SENSOR[N] = {A0};            // wiper of the fader
const uint8_t FORWARD[N] = {2};            // PWM inputs of the bridge: towards positive positions
const uint8_t BACKWARD[N] = {3};           // and away from them
const int TOUCH = -1;                      // a pin that is high while a finger is there; -1: none

const uint8_t ADC_BITS = 12;
const uint8_t PWM_BITS = 10;
const float PWM_HERTZ = 25000;             // above hearing
const float TRAVEL = 0.100f;               // metres from end to end
const float FORCE_MAX = 1.5f;              // newtons at full duty
const float FORCE_HOURS = 1.0f;            // newtons that the motor bears for hours
const float EXCHANGES = 1000;              // a second, as far as the wire and the sensor go
const uint32_t SILENCE_US = 50000;         // then the motors let go

// --- the frame ----------------------------------------------------------------------------------

const uint8_t FLAG_ENABLE = 1, FLAG_ASK = 2;
const uint8_t STATUS_TOUCHED = 1, STATUS_ENABLED = 2, STATUS_LET_GO = 8;
const uint8_t WIDE = 0x80;

uint8_t in[64];
uint8_t out[96];
uint8_t length = 0;

uint32_t heard_us = 0;
bool let_go = true;
bool enabled = false;

static uint16_t crc(const uint8_t *bytes, uint8_t n) {
  uint16_t sum = 0xFFFF;
  while (n--) {
    sum ^= (uint16_t)*bytes++ << 8;
    for (uint8_t bit = 0; bit < 8; bit++) {
      sum = sum & 0x8000 ? (sum << 1) ^ 0x1021 : sum << 1;
    }
  }
  return sum;
}

static bool touched() { return TOUCH < 0 || digitalRead(TOUCH); }

// Duty from -1 to 1; both inputs low is a bridge that pushes nothing.
static void push(uint8_t axis, float duty) {
  const float full = (float)((1 << PWM_BITS) - 1);
  duty = constrain(duty, -1.0f, 1.0f);
  analogWrite(FORWARD[axis], duty > 0 ? (int)(duty * full) : 0);
  analogWrite(BACKWARD[axis], duty < 0 ? (int)(-duty * full) : 0);
}

static void release_all() {
  for (uint8_t axis = 0; axis < N; axis++) push(axis, 0);
  enabled = false;
}

// Tens of nanometres from the middle.
static int32_t position(uint8_t axis) {
  const float full = (float)((1 << ADC_BITS) - 1);
  return (int32_t)lroundf((analogRead(SENSOR[axis]) / full - 0.5f) * TRAVEL * 1e8f);
}

static void send(uint8_t n) {
  const uint16_t sum = crc(out + 2, n - 2);
  memcpy(out + n, &sum, 2);
  Serial.write(out, n + 2);
#if defined(TEENSYDUINO)
  Serial.send_now();                       // a packet that waits is a late force
#else
  Serial.flush();
#endif
}

static void say_where(uint16_t number, uint8_t status) {
  const uint32_t now = micros();
  out[0] = 0xA5;
  out[1] = 0x5A;
  memcpy(out + 2, &number, 2);
  memcpy(out + 4, &now, 4);
  out[8] = N;
  for (uint8_t axis = 0; axis < N; axis++) {
    const int32_t x = position(axis);
    memcpy(out + 9 + 4 * axis, &x, 4);
  }
  out[9 + 4 * N] = status;
  send(10 + 4 * N);
}

static void say_who(uint16_t number) {
  const float step = TRAVEL / (float)((1 << ADC_BITS) - 1);
  const float numbers[8] = {FORCE_HOURS, FORCE_MAX, step, -TRAVEL / 2, TRAVEL / 2, EXCHANGES, 0, 0};
  out[0] = 0xA5;
  out[1] = 0x5D;
  memcpy(out + 2, &number, 2);
  out[4] = N;
  out[5] = TOUCH < 0 ? 0 : 2;
  memcpy(out + 6, numbers, sizeof numbers);
  send(6 + sizeof numbers);
}

static void heard(uint16_t number, uint8_t n, const uint8_t *forces, uint8_t flags) {
  if (n == 0) {
    say_who(number);
    return;
  }
  uint8_t status = let_go ? STATUS_LET_GO : 0;
  if (!(flags & FLAG_ASK)) {
    heard_us = micros();
    let_go = false;
    enabled = (flags & FLAG_ENABLE) && touched();
    for (uint8_t axis = 0; axis < N; axis++) {
      int16_t steps;
      memcpy(&steps, forces + 2 * axis, 2);
      push(axis, enabled ? steps / 32767.0f : 0);
    }
  }
  if (touched()) status |= STATUS_TOUCHED;
  if (enabled) status |= STATUS_ENABLED;
  say_where(number, status);
}

static void drop(uint8_t n) {
  length -= n;
  memmove(in, in + n, length);
}

// Take what is a whole frame from the front of `in`; pass over what is none. False: wait for more.
static bool take() {
  if (length && in[0] != 0xA5) {
    drop(1);
    return true;
  }
  if (length < 5) return false;
  const uint8_t n = in[4];
  if (in[1] != 0x5A || (n != 0 && n != N)) {  // also wide frames: this board has no use for them
    drop(1);
    return true;
  }
  const uint8_t whole = 8 + 2 * n;
  if (length < whole) return false;
  uint16_t sum, number;
  memcpy(&sum, in + whole - 2, 2);
  if (crc(in + 2, whole - 4) != sum) {
    drop(1);
    return true;
  }
  memcpy(&number, in + 2, 2);
  heard(number, n, in + 5, in[whole - 3]);
  drop(whole);
  return true;
}

void setup() {
  Serial.begin(1000000);
  analogReadResolution(ADC_BITS);
#if defined(TEENSYDUINO)
  analogWriteResolution(PWM_BITS);
  for (uint8_t axis = 0; axis < N; axis++) {
    analogWriteFrequency(FORWARD[axis], PWM_HERTZ);
    analogWriteFrequency(BACKWARD[axis], PWM_HERTZ);
  }
#else
  analogWriteRange((1 << PWM_BITS) - 1);
  analogWriteFreq((uint32_t)PWM_HERTZ);
#endif
  for (uint8_t axis = 0; axis < N; axis++) {
    pinMode(FORWARD[axis], OUTPUT);
    pinMode(BACKWARD[axis], OUTPUT);
  }
  if (TOUCH >= 0) pinMode(TOUCH, INPUT);
  release_all();
}

// A serial port has one host. Where packets come from several (Ethernet), answer nobody but the sender whose forces act,
// until it sends flags without FLAG_ENABLE and FLAG_ASK, or until let_go.
void loop() {
  while (Serial.available() && length < sizeof in) in[length++] = Serial.read();
  while (take()) {
  }
  if (!let_go && micros() - heard_us > SILENCE_US) {
    release_all();
    let_go = true;
  }
}
