"""The vocabulary: primitives, symbolic state, and the rules that judge motions."""
