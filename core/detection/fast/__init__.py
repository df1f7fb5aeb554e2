"""The fused fast path: all stages of the readable pipeline in one compiled call per window."""
