#define FACETCAM_ISA avx2
#include "corner_kernels.inl"
