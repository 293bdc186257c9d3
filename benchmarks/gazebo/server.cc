// Gazebo 11 in lockstep with a client: server WORLD SOCKET SEED WEIGHT JOINT...
//
// All messages are doubles. SOCKET is the number of an open stream socket; SEED is that of the sensors' noise.
// WEIGHT is that of the newest difference of positions in the joint velocities, as in Unitree's controller; 0: Gazebo's velocities. Requests:
//   0, height, then (nj) joint positions, effort limits, torque gains: places model "robot" at rest, and returns (nj + 1, 10) values
//      of link "base" and the joints' links: mass, CoM, inertia xx yy zz xy xz yz about the CoM, in the frame of "base".
//   n > 0, then (nj) kp, (nj) kd, (n, nj) position targets: makes n steps with joint PD, and returns (n + 1, 3 nj + 6) rows and the
//      cosine of the base's tilt. A row has the positions, velocities and torques of the joints and the IMU's angular velocity
//      and acceleration at the start of a step; the last row, without torques, is the present state.

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <string>
#include <vector>

#include <gazebo/common/Events.hh>
#include <gazebo/gazebo.hh>
#include <gazebo/physics/physics.hh>
#include <gazebo/sensors/sensors.hh>
#include <gazebo/transport/TopicManager.hh>
#include <ignition/math/Rand.hh>

using namespace gazebo;
using Values = std::vector<double>;

static int stream;

static Values receive(size_t count) {
  Values values(count);
  auto at = reinterpret_cast<char*>(values.data()), end = at + count * sizeof(double);
  while (at < end) {
    auto got = recv(stream, at, end - at, 0);
    if (got <= 0) _exit(0);  // the client has ended
    at += got;
  }
  return values;
}

static void reply(const Values& values) {
  auto at = reinterpret_cast<const char*>(values.data()), end = at + values.size() * sizeof(double);
  while (at < end) {
    auto sent = send(stream, at, end - at, MSG_NOSIGNAL);
    if (sent <= 0) _exit(0);
    at += sent;
  }
}

int main(int count, char** arguments) {
  ignition::math::Rand::Seed(std::stoul(arguments[3]));
  gazebo::setupServer(1, arguments);
  auto world = gazebo::loadWorld(arguments[1]);
  stream = std::stoi(arguments[2]);
  auto model = world->ModelByName("robot");
  auto base = model->GetLink("base");
  std::vector<physics::JointPtr> joints;
  for (int i = 5; i < count; i++) joints.push_back(model->GetJoint(arguments[i]));
  sensors::run_once(true);
  auto imu = std::dynamic_pointer_cast<sensors::ImuSensor>(sensors::get_sensor("imu"));
  if (!imu || model->GetLinks().size() != joints.size() + 1) {
    std::cerr << "no sensor 'imu', or links that no given joint moves" << std::endl;
    return 1;
  }

  const size_t n = joints.size();
  const double weight = std::stod(arguments[4]), h = world->Physics()->GetMaxStepSize();
  Values limit(n), gain(n), kp, kd, targets, rows, seen(6), last(n), velocity(n);
  size_t step = 0;
  auto sense = [&] {  // appends a row, torques zero
    for (auto& joint : joints) rows.push_back(joint->Position(0));
    rows.insert(rows.end(), velocity.begin(), velocity.end());
    rows.resize(rows.size() + n);
    rows.insert(rows.end(), seen.begin(), seen.end());
  };
  auto begin = event::Events::ConnectWorldUpdateBegin([&](const common::UpdateInfo&) {
    sense();
    double* row = &rows[rows.size() - (3 * n + 6)];
    for (size_t i = 0; i < n; i++) {
      double torque = kp[i] * (targets[step * n + i] - row[i]) - kd[i] * row[n + i];
      row[2 * n + i] = std::max(-limit[i], std::min(limit[i], torque));
      joints[i]->SetForce(0, gain[i] * row[2 * n + i]);
    }
    step++;
  });
  auto end = event::Events::ConnectWorldUpdateEnd([&] {
    auto now = world->SimTime();
    while (imu->LastMeasurementTime() != now) {  // the sensor's data come by a topic, which another thread may be serving
      transport::TopicManager::Instance()->ProcessNodes();
      imu->Update(true);
    }
    for (size_t i = 0; i < n; i++) {
      double position = joints[i]->Position(0), slope = (position - last[i]) / h;
      velocity[i] = weight > 0 ? (1 - weight) * velocity[i] + weight * slope : joints[i]->GetVelocity(0);
      last[i] = position;
    }
    auto turn = imu->AngularVelocity(), force = imu->LinearAcceleration();
    seen = {turn.X(), turn.Y(), turn.Z(), force.X(), force.Y(), force.Z()};
  });

  for (;;) {
    auto steps = static_cast<unsigned>(receive(1)[0]);
    if (steps > 0) {
      kp = receive(n), kd = receive(n), targets = receive(steps * n);
      step = 0, rows.clear();
      gazebo::runWorld(world, steps);
      sense();
      rows.push_back(base->WorldPose().Rot().RotateVector({0, 0, 1}).Z());
      reply(rows);
      continue;
    }
    auto height = receive(1)[0];
    auto positions = receive(n);
    limit = receive(n), gain = receive(n);
    model->SetWorldPose({0, 0, height, 0, 0, 0});
    for (size_t i = 0; i < n; i++) joints[i]->SetPosition(0, positions[i], false);
    model->ResetPhysicsStates();
    last = positions, std::fill(velocity.begin(), velocity.end(), 0.0);
    Values table;
    for (size_t i = 0; i <= n; i++) {
      auto link = i == 0 ? base : joints[i - 1]->GetChild();
      auto own = link->GetInertial()->Ign();
      auto pose = link->WorldPose() - base->WorldPose();
      auto com = pose.Pos() + pose.Rot().RotateVector(own.Pose().Pos());
      ignition::math::Matrix3d axes(pose.Rot());
      auto about = axes * own.Moi() * axes.Transposed();
      table.insert(table.end(), {own.MassMatrix().Mass(), com.X(), com.Y(), com.Z(), about(0, 0), about(1, 1), about(2, 2)});
      table.insert(table.end(), {about(0, 1), about(0, 2), about(1, 2)});
    }
    reply(table);
  }
}
