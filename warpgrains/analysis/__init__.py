"""What a state, a step or a recording amounts to, and how exact it is."""
