"""The robot protocol, descriptions of arms, the simulated arm and a real Franka."""
