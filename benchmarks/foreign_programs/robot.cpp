// An A1 that stands still, made of Unitree's own SDK 3.3.1 as a server of its structures: what a driver sends it reads, checks and counts.

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <unistd.h>

#include "unitree_legged_sdk/udp.h"  // the whole SDK would need boost

using namespace UNITREE_LEGGED_SDK;

int main(int, char** given) {
  UDP udp((uint16_t)atoi(given[1]), sizeof(LowState), sizeof(LowCmd), true);
  LowCmd command = {}, stiff = {};
  LowState state = {};
  state.levelFlag = LOWLEVEL;
  for (int motor = 0; motor < 12; ++motor) {
    state.motorState[motor].q = motor % 3 == 0 ? 0.0f : motor % 3 == 1 ? 0.8f : -1.6f;
    state.motorState[motor].temperature = 30;
  }
  state.imu.accelerometer[2] = 9.81f;
  fprintf(stdout, "{\"ready\": true}\n");
  fflush(stdout);
  for (int period = 0; period < atoi(given[2]); ++period) {
    udp.Recv();
    udp.GetRecv((char*)&command);
    if (command.motorCmd[2].Kp > 0) stiff = command;
    state.tick += 2;
    udp.SetSend((char*)&state);
    udp.Send();
    usleep(2000);
  }
  printf("{\"sent\": %llu, \"received\": %llu, \"crc_errors\": %llu, \"flag_errors\": %llu, \"level\": %d, \"mode\": %d, \"q\": %.4f, \"kp\": %.3f, \"kd\": %.3f}\n",
         udp.udpState.SendCount, udp.udpState.RecvCount, udp.udpState.RecvCRCError, udp.udpState.FlagError, stiff.levelFlag,
         stiff.motorCmd[2].mode, stiff.motorCmd[2].q, stiff.motorCmd[2].Kp, stiff.motorCmd[2].Kd);
}
