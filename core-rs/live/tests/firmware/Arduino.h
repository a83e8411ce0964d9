// A computer in place of a board: the sketch's calls, a pseudo-terminal for its serial port, and a fader that
// its motor moves. The path of the terminal is the first line of output.
//
// Time is counted, so that a busy machine changes nothing: every reply takes 1 ms, and so does every byte of
// standard input, which is answered by a byte on standard output. The end of standard input ends the program.
#pragma once
#include <fcntl.h>
#include <pty.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <termios.h>
#include <unistd.h>

#define A0 14
#define OUTPUT 1
#define INPUT 0
#define constrain(x, a, b) ((x) < (a) ? (a) : ((x) > (b) ? (b) : (x)))

static uint32_t now_us = 0;
static uint32_t micros() { return now_us; }

// 1.5 N at full duty against 3 N·s/m of friction, 100 mm from end to end.
static double duty[2], place = 0.5;
static void pass_a_millisecond() {
  now_us += 1000;
  place += 1.5 * (duty[0] - duty[1]) / 3.0 * 1e-3 / 0.1;
  place = constrain(place, 0.0, 1.0);
}
static void analogWrite(int pin, int value) { duty[pin - 2] = value / 1023.0; }
static int analogRead(int) { return (int)(place * 4095 + 0.5); }
static bool digitalRead(int) { return true; }
static void pinMode(int, int) {}
static void analogReadResolution(int) {}
static void analogWriteRange(int) {}
static void analogWriteFreq(uint32_t) {}

static struct {
  int port, held, ahead;
  void begin(long) {
    struct termios raw;
    char path[128];
    cfmakeraw(&raw);
    if (openpty(&port, &held, path, &raw, NULL) != 0) _exit(1);
    fcntl(port, F_SETFL, O_NONBLOCK);
    ahead = -1;
    puts(path);
    fflush(stdout);
  }
  int available() {
    unsigned char byte;
    if (ahead < 0 && ::read(port, &byte, 1) == 1) ahead = byte;
    return ahead >= 0;
  }
  int read() {
    const int byte = ahead;
    ahead = -1;
    return byte;
  }
  void write(const uint8_t *bytes, size_t n) {
    (void)!::write(port, bytes, n);
    pass_a_millisecond();
  }
  void flush() {}
} Serial;

void setup();
void loop();
int main() {
  setup();
  fcntl(STDIN_FILENO, F_SETFL, O_NONBLOCK);
  for (;;) {
    char byte;
    const ssize_t got = ::read(STDIN_FILENO, &byte, 1);
    if (got == 0) return 0;
    if (got == 1) pass_a_millisecond();
    loop();
    if (got == 1) (void)!::write(STDOUT_FILENO, &byte, 1);
    else usleep(20);
  }
}
