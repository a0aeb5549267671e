#define FACETCAM_ISA baseline
#include "corner_kernels.inl"
