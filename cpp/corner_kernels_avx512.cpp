#define FACETCAM_ISA avx512
#include "corner_kernels.inl"
