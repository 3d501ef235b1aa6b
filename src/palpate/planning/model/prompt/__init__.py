"""The prompt: the fixed system prompt S, and the message that carries R, D, poses and I."""
