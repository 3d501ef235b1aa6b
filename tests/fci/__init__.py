"""A Franka over libfranka's own protocol, in palpate's hidden world: what `robots/franky` is tested
against where there is no hardware.

    with served(**files("bottle_and_table"), noise="lab", seed=0) as bench:
        robot = franky.Robot(bench.address, realtime_config=franky.RealtimeConfig.Ignore)
        bench.ask("truth", name="bottle.mass")

A process of its own serves it (`python -m tests.fci`), in one thread, one control cycle of 1 ms at
a time, in lockstep with its client (`server`). World, joint friction, torque sensors, encoders and
fingers are those of the embedded robot (`plant`, `sensing`); the client's torques drive the joints
instead of its controller. The arm compensates gravity by the nominal model and the end effector
that was configured (`believed`), watches its limits and the client's thresholds (`robot`), and has
controllers of its own for the client's motion generators (`control`). The door (`door`) is for
truth and mishaps.

Answered: Connect, Move (torques; joint and Cartesian positions and velocities with joint and
Cartesian impedance), StopMove, SetCollisionBehavior, SetJointImpedance, SetCartesianImpedance,
SetGuidingMode, SetEEToK, SetNEToEE, SetLoad, AutomaticErrorRecovery, GetRobotModel; of the hand
Connect, Homing, Grasp, Move, Stop.

What a real Franka does and this one does not:

- Its inner torque loop works against friction in the gears and the motors' inertia. Here a commanded
  torque acts on motors that are as heavy as they are, as in the embedded robot, and friction is seen
  by the sensors alone.
- Its internal controllers and its inverse kinematics are not published. Joint and Cartesian
  impedance here are plain ones with the client's stiffness; where nobody commands, a stiff position
  controller holds the arm, and brakes do not click in.
- A collision is judged by a momentum observer with the embedded robot's time constant of 10 ms; the
  real one's is not published. After a reflex the arm is held where it was.
- Cartesian limits, the elbow's own limits, singularities, self-collision, power and energy are not
  watched; limits of acceleration and jerk of commanded motions are two thresholds, not the
  firmware's. Move's path deviations and asynchronous motion generators are refused or not heeded.
- `theta` is `q`, accelerometers say nothing, and `O_ddP_O` is gravity. Errors need no time to be
  recovered from, nor a stop to be released; Desk's control token, safety functions and joint
  position errors are not there.
- Loops lose commands, never states; networks have no jitter. Acquisition faults of a noise model
  reach the torques as the embedded robot's blocks of 5 ms; its clock's error is left out.
- The hand goes at once, has no backlash, needs no minimal force and does not overheat. Stop lets
  fingers stand where they are without pressing.
- A second client takes the place of the first one.
"""
