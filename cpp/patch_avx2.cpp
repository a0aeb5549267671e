#define FACETCAM_ISA avx2
#include "patch.inl"
