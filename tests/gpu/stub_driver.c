/* SPDX-License-Identifier: Apache-2.0
 *
 * A CUDA driver without a card, for `tests.gpu.stub_driver`. Memory of the card is the host's, and kernels do nothing.
 * STUB_PTX: a folder that receives the code of all kernels. STUB_LOG: a file with a line for each launch: kernel, blocks,
 * threads, bytes of arguments, and the arguments, with a hash of the first bytes of an array in place of its address.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define SLOTS (1u << 20)
#define HASHED 4096

typedef uint64_t address;
static address starts[SLOTS];
static size_t sizes[SLOTS];
static void *context;

static uint32_t first_slot(address a) { return (uint32_t)((a >> 8) * 0x9E3779B97F4A7C15ull >> 44); }

static void remember(address a, size_t size) {
    uint32_t slot = first_slot(a);
    while (starts[slot % SLOTS] > 1 && starts[slot % SLOTS] != a) slot++;
    starts[slot % SLOTS] = a;
    sizes[slot % SLOTS] = size;
}

static size_t size_at(address a) {
    for (uint32_t slot = first_slot(a); starts[slot % SLOTS]; slot++)
        if (starts[slot % SLOTS] == a) return sizes[slot % SLOTS];
    return 0;
}

static void forget(address a) {
    for (uint32_t slot = first_slot(a); starts[slot % SLOTS]; slot++)
        if (starts[slot % SLOTS] == a) {
            starts[slot % SLOTS] = 1; /* others may follow */
            return;
        }
}

static uint64_t hash(const uint8_t *bytes, size_t count) {
    uint64_t value = 1469598103934665603ull; /* FNV-1a */
    for (size_t i = 0; i < count; i++) value = (value ^ bytes[i]) * 1099511628211ull;
    return value;
}

int cuMemAlloc_v2(address *result, size_t size) {
    void *memory = aligned_alloc(256, (size + 511) / 256 * 256);
    if (!memory) return 2;
    if (size < (1u << 28)) memset(memory, 0, size);
    *result = (address)memory;
    remember(*result, size);
    return 0;
}
int cuMemAllocAsync(address *result, size_t size, void *stream) { return cuMemAlloc_v2(result, size); }
int cuMemAllocManaged(address *result, size_t size, int flags) { return cuMemAlloc_v2(result, size); }
int cuMemFree_v2(address a) { forget(a); free((void *)a); return 0; }
int cuMemFreeAsync(address a, void *stream) { return cuMemFree_v2(a); }
int cuMemGetInfo_v2(size_t *available, size_t *total) { *available = *total = 2000000000u; return 0; }
int cuMemcpyDtoD_v2(address to, address from, size_t size) { memcpy((void *)to, (void *)from, size); return 0; }
int cuMemcpyDtoH_v2(void *to, address from, size_t size) { memcpy(to, (void *)from, size); return 0; }
int cuMemcpyHtoD_v2(address to, void *from, size_t size) { memcpy((void *)to, from, size); return 0; }
int cuMemcpyDtoHAsync_v2(void *to, address from, size_t size, void *s) { return cuMemcpyDtoH_v2(to, from, size); }
int cuMemcpyHtoDAsync_v2(address to, void *from, size_t size, void *s) { return cuMemcpyHtoD_v2(to, from, size); }
int cuMemcpyAsync(address to, address from, size_t size, void *s) { return cuMemcpyDtoD_v2(to, from, size); }
int cuMemsetD32_v2(address a, uint32_t value, size_t count) {
    for (size_t i = 0; i < count; i++) ((uint32_t *)a)[i] = value;
    return 0;
}
int cuMemsetD8_v2(address a, uint8_t value, size_t count) { memset((void *)a, value, count); return 0; }

int cuModuleLoadDataEx(void **module, const char *code, unsigned count, int *options, void **values) {
    static int loaded;
    const char *folder = getenv("STUB_PTX");
    if (folder) {
        char path[4096];
        snprintf(path, sizeof path, "%s/%d_%04d.ptx", folder, (int)getpid(), loaded++);
        FILE *file = fopen(path, "w");
        if (!file) return 1;
        fputs(code, file);
        fclose(file);
    }
    *module = (void *)1;
    return 0;
}
int cuModuleGetFunction(void **function, void *module, const char *name) { *function = strdup(name); return 0; }

int cuLaunchKernel(void *function, unsigned blocks, unsigned by, unsigned bz, unsigned threads, unsigned ty, unsigned tz,
                   unsigned shared, void *stream, void **parameters, void **extra) {
    static FILE *file;
    if (!file && getenv("STUB_LOG")) file = fopen(getenv("STUB_LOG"), "w");
    if (!file) return 0;
    address arguments = **(address **)parameters; /* first member of Taichi's RuntimeContext */
    size_t size = size_at(arguments);
    fprintf(file, "%s %u %u %zu:", (char *)function, blocks, threads, size);
    for (size_t i = 0; i < size;) {
        address word = i % 8 == 0 && i + 8 <= size ? *(address *)(arguments + i) : 0;
        size_t bytes = size_at(word);
        if (bytes)
            fprintf(file, " [%zu %llx]", bytes, (unsigned long long)hash((uint8_t *)word, bytes < HASHED ? bytes : HASHED));
        else
            fprintf(file, " %x", *(uint32_t *)(arguments + i));
        i += bytes ? 8 : 4;
    }
    fputc('\n', file);
    fflush(file);
    return 0;
}

int cuInit(unsigned flags) { return 0; }
int cuDriverGetVersion(int *version) { *version = 12090; return 0; }
int cuDeviceGetCount(int *count) { *count = 1; return 0; }
int cuDeviceGet(int *device, int number) { *device = 0; return 0; }
int cuDeviceGetName(char *name, int size, int device) { snprintf(name, (size_t)size, "stub"); return 0; }
int cuDeviceGetAttribute(int *value, int attribute, int device) {
    *value = attribute == 75 ? 8 : attribute == 76 ? 6 : attribute == 16 ? 64 : attribute == 1 ? 1024 : 1;
    if (attribute == 8 || attribute == 97) *value = 49152; /* shared memory of a block */
    if (attribute == 39) *value = 2048;                    /* threads of a multiprocessor */
    return 0;
}
int cuDeviceGetDefaultMemPool(void **pool, int device) { *pool = (void *)1; return 0; }
int cuDevicePrimaryCtxRetain(void **result, int device) { *result = (void *)1; return 0; }
int cuCtxCreate_v2(void **result, int flags, int device) { *result = context = (void *)1; return 0; }
int cuCtxGetCurrent(void **result) { *result = context; return 0; }
int cuCtxSetCurrent(void *chosen) { context = chosen; return 0; }
int cuPointerGetAttribute(unsigned *value, int attribute, address a) { *value = size_at(a) ? 2 : 1; return 0; }
int cuOccupancyMaxActiveBlocksPerMultiprocessor(int *n, void *f, int b, size_t s) { *n = 8; return 0; }
int cuEventCreate(void **event, unsigned flags) { *event = (void *)1; return 0; }
int cuEventElapsedTime(float *time, void *first, void *last) { *time = 0; return 0; }
int cuFuncGetAttribute(int *value, int attribute, void *function) { *value = 0; return 0; }
int cuStreamCreate(void **stream, unsigned flags) { *stream = (void *)1; return 0; }
int cuGetErrorName(int error, const char **name) { *name = "error"; return 0; }
int cuGetErrorString(int error, const char **text) { *text = "error"; return 0; }

/* What Taichi loads, but needs no answer from. */
#define NOTHING(name) int name() { return 0; }
NOTHING(cuMemPoolSetAttribute)
NOTHING(cuMemAdvise)
NOTHING(cuCtxSetLimit)
NOTHING(cuEventDestroy)
NOTHING(cuEventRecord)
NOTHING(cuEventSynchronize)
NOTHING(cuFuncSetAttribute)
NOTHING(cuModuleUnload)
NOTHING(cuStreamDestroy)
NOTHING(cuStreamSynchronize)
NOTHING(cuImportExternalMemory)
NOTHING(cuImportExternalSemaphore)
NOTHING(cuExternalMemoryGetMappedBuffer)
NOTHING(cuExternalMemoryGetMappedMipmappedArray)
NOTHING(cuMipmappedArrayGetLevel)
NOTHING(cuSurfObjectCreate)
NOTHING(cuSignalExternalSemaphoresAsync)
NOTHING(cuWaitExternalSemaphoresAsync)
