// A computer that commands a robot by Unitree's own SDK: holds the robot where it is, turns one knee by a step, and says what came back.
//
// With SDK 3.3.1 (A1) the robot is at the SDK's own address; with 3.8 (Go1), at the address given: computer ADDRESS PORT.

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <unistd.h>

#include "unitree_legged_sdk/udp.h"  // the whole SDK would need boost

using namespace UNITREE_LEGGED_SDK;

static const int PERIODS = 2000, STEP_AT = 1000, KNEE = 2;
static const double STEP = 0.1;  // [rad]

int main(int, char** given) {
#ifdef GO1
  UDP udp(LOWLEVEL, 8090, given[1], (uint16_t)atoi(given[2]));
#else
  (void)given;
  UDP udp(LOWLEVEL);
#endif
  LowCmd command = {};
  LowState state = {};
  udp.InitCmdData(command);
  double start[12] = {}, moved = 0, other = 0, up = 0, turning = 0;
  bool heard = false;
  for (int period = 0; period < PERIODS; ++period) {
    udp.Recv();
    udp.GetRecv(state);
    if (!heard && udp.udpState.RecvCount > 50) {
      heard = true;
      for (int motor = 0; motor < 12; ++motor) start[motor] = state.motorState[motor].q;
    }
    for (int motor = 0; motor < 12 && heard; ++motor) {
      command.motorCmd[motor].mode = 0x0A;
      command.motorCmd[motor].q = start[motor] + (motor == KNEE && period > STEP_AT ? STEP : 0.0);
      command.motorCmd[motor].dq = 0;
      command.motorCmd[motor].Kp = 100;
      command.motorCmd[motor].Kd = 3;
      command.motorCmd[motor].tau = 0;
    }
    udp.SetSend(command);
    udp.Send();
    usleep(2000);
  }
  for (int motor = 0; motor < 12; ++motor) {
    double way = std::fabs(state.motorState[motor].q - start[motor]);
    (motor == KNEE ? moved : other) = motor == KNEE ? way : std::fmax(other, way);
  }
  up = state.imu.accelerometer[2];
  turning = std::fabs(state.imu.gyroscope[0]);
  printf("{\"sent\": %llu, \"received\": %llu, \"crc_errors\": %llu, \"flag_errors\": %llu, \"knee\": %.4f, \"others\": %.4f, \"up\": %.3f, \"turning\": %.4f}\n",
         udp.udpState.SendCount, udp.udpState.RecvCount, udp.udpState.RecvCRCError, udp.udpState.FlagError, moved, other, up, turning);
  return heard ? 0 : 1;
}
