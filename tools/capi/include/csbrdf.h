/*
 * csbrdf: measured BRDFs from compressed files, whole, by blocks, or at pairs of directions.
 *
 *     csbrdf_brdf *brdf;
 *     if (csbrdf_open_path("chrome.csbrdf", &brdf) != CSBRDF_OK) {
 *         char message[256];
 *         csbrdf_last_error(message, sizeof message);
 *         ...
 *     }
 *     const double wi[3] = {0.3, 0.0, 0.9}, wo[3] = {-0.5, 0.1, 0.8};
 *     float rgb[3]; // 1/sr
 *     csbrdf_status status = csbrdf_eval(brdf, wi, wo, rgb, 3);
 *     csbrdf_close(brdf);
 *
 * Pointers: NULL where something is needed is CSBRDF_INVALID_ARGUMENT, but an array of length 0 may be NULL. Any
 * other pointer must be valid, aligned for its type, and good for as many elements as the function says. Memory is
 * the caller's, but for handles; what a function writes to must not overlap what it reads. What an output holds
 * after a failure is not specified, but for handles, which are NULL then.
 *
 * Threads: any number of threads may use one handle at the same time, in every function but csbrdf_close(). The
 * message of csbrdf_last_error() is that of the calling thread. Values do not depend on which threads ask, when, or
 * for what else.
 *
 * Failures: every function returns, and none throws. A bug in the library that is caught (CSBRDF_PANIC) also leaves
 * a note on stderr. The program ends only if memory runs out, or if a mapped file shrinks (csbrdf_open_path()).
 *
 * Made by cbindgen from src/lib.rs; `cargo test` in tools/capi tells how to make it anew.
 */

#ifndef CSBRDF_H
#define CSBRDF_H

#include <stddef.h>
#include <stdint.h>

/**
 * Version of the interface in this header. It changes when a program that was compiled with one header cannot use a
 * library built from the other; compare with csbrdf_abi_version().
 */
#define CSBRDF_ABI_VERSION 1

/**
 * csbrdf_options.lookup: linear between bin centres on every axis. The default.
 */
#define CSBRDF_LOOKUP_LINEAR 0

/**
 * csbrdf_options.lookup: the bin that the directions fall into.
 */
#define CSBRDF_LOOKUP_NEAREST 1

/**
 * csbrdf_options.pruned: a block that was pruned from the file is CSBRDF_PRUNED. The default.
 */
#define CSBRDF_PRUNED_REFUSE 0

/**
 * csbrdf_options.pruned: a block that was pruned gives its mean.
 */
#define CSBRDF_PRUNED_COARSE 1

/**
 * What came of a call. csbrdf_last_error() has the details. Later versions may add codes.
 */
typedef enum {
    /**
     * It did what was asked.
     */
    CSBRDF_OK = 0,
    /**
     * The operating system refused: the file is missing, or cannot be read or mapped.
     */
    CSBRDF_IO = 1,
    /**
     * The bytes are not a csbrdf file.
     */
    CSBRDF_NOT_CSBRDF = 2,
    /**
     * A csbrdf file of a version that this library does not read.
     */
    CSBRDF_UNSUPPORTED_VERSION = 3,
    /**
     * The file ends before its contents do.
     */
    CSBRDF_TRUNCATED = 4,
    /**
     * The file is damaged, or contradicts itself.
     */
    CSBRDF_CORRUPT = 5,
    /**
     * A size in the file is above the limit in csbrdf_options.
     */
    CSBRDF_LIMIT_EXCEEDED = 6,
    /**
     * An argument is NULL or out of its range, an array has the wrong length, or the file cannot answer the question.
     */
    CSBRDF_INVALID_ARGUMENT = 7,
    /**
     * A bug in the library was caught. The handle can still be used and closed.
     */
    CSBRDF_PANIC = 8,
    /**
     * A block that the call needs was pruned from the file, and the options do not allow its mean in its place.
     */
    CSBRDF_PRUNED = 9,
} csbrdf_status;

/**
 * An open file.
 */
typedef struct csbrdf_brdf csbrdf_brdf;

/**
 * How to open a file. A field that is 0 takes its default: start with `csbrdf_options options = {0};` (C++:
 * `csbrdf_options options{};`) and set `options.size = sizeof options`.
 */
typedef struct {
    /**
     * sizeof(csbrdf_options). Tells the library which fields the program knows; later versions append some.
     */
    size_t size;
    /**
     * Most bytes of decoded blocks that the handle keeps for csbrdf_eval(). Default 64 MiB; one block is kept
     * whatever it takes.
     */
    size_t cache_bytes;
    /**
     * Most values (positions times channels) of a block: a file with larger ones is CSBRDF_LIMIT_EXCEEDED. Decoding a
     * block takes some 20 bytes a value. Default and upper bound 2^24, the most that the format allows.
     */
    size_t max_block_values;
    /**
     * CSBRDF_LOOKUP_LINEAR or CSBRDF_LOOKUP_NEAREST.
     */
    uint32_t lookup;
    /**
     * CSBRDF_PRUNED_REFUSE or CSBRDF_PRUNED_COARSE.
     */
    uint32_t pruned;
} csbrdf_options;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * CSBRDF_ABI_VERSION of the library.
 */
uint32_t csbrdf_abi_version(void);

/**
 * Version of the library, such as "0.1.0". The string is never freed.
 */
const char *csbrdf_version(void);

/**
 * Copies the message of the calling thread's last call that failed, in English and UTF-8, into `buffer`: at most
 * `size` bytes with the terminating NUL, cut between characters. Calls that succeed leave the message as it is.
 *
 * Returns the length of the whole message in bytes, without the NUL (as snprintf does): it was cut if that is `size`
 * or more. 0 if no call has failed. `buffer` may be NULL to ask for the length alone.
 */
size_t csbrdf_last_error(char *buffer,
                         size_t size);

/**
 * Opens the file at a path in UTF-8 (NUL-terminated) and puts a handle to close into `*out`, or NULL on failure.
 * Reads and checks the header and the index; blocks are read when they are first needed.
 *
 * The file is mapped into memory. It may be replaced by renaming another over it, but must not be written to or
 * truncated while the handle is open: the process would end by SIGBUS. Where that can happen, read it and use
 * csbrdf_open_memory().
 */
csbrdf_status csbrdf_open_path(const char *utf8_path,
                               csbrdf_brdf **out);

/**
 * As csbrdf_open_path(), with options; NULL for the default ones.
 */
csbrdf_status csbrdf_open_path_with(const char *utf8_path, const csbrdf_options *options, csbrdf_brdf **out);

/**
 * Opens a file of `size` bytes in memory, which are copied, and puts a handle to close into `*out`, or NULL on
 * failure.
 */
csbrdf_status csbrdf_open_memory(const uint8_t *data,
                                 size_t size,
                                 csbrdf_brdf **out);

/**
 * As csbrdf_open_memory(), with options; NULL for the default ones.
 */
csbrdf_status csbrdf_open_memory_with(const uint8_t *data,
                                      size_t size,
                                      const csbrdf_options *options,
                                      csbrdf_brdf **out);

/**
 * Closes a handle; NULL is allowed and does nothing. No other call may be using the handle, nor use it afterwards.
 */
void csbrdf_close(csbrdf_brdf *brdf);

/**
 * Number of axes of the grid, 1 to 4.
 */
csbrdf_status csbrdf_axis_count(const csbrdf_brdf *brdf, size_t *count);

/**
 * Number of channels, 1 to 4096: 3 for R, G, B.
 */
csbrdf_status csbrdf_channel_count(const csbrdf_brdf *brdf, size_t *count);

/**
 * Number of blocks, at least 1.
 */
csbrdf_status csbrdf_block_count(const csbrdf_brdf *brdf, size_t *count);

/**
 * Number of bins along each axis, slowest axis first, with ones in front where there are fewer than four axes: 1, 90,
 * 90, 180 for MERL's theta_h, theta_d, phi_d.
 */
csbrdf_status csbrdf_grid_shape(const csbrdf_brdf *brdf,
                                size_t shape[4]);

/**
 * Number of values of the whole table: positions of the grid times channels. The length that csbrdf_decode_all()
 * needs.
 */
csbrdf_status csbrdf_table_size(const csbrdf_brdf *brdf,
                                size_t *values);

/**
 * Number of values of a block: its positions times channels. The length that csbrdf_decode_block() needs.
 */
csbrdf_status csbrdf_block_size(const csbrdf_brdf *brdf, size_t block, size_t *values);

/**
 * Where a block stands: position of its first bin and its bins along each axis, both in the axes of
 * csbrdf_grid_shape().
 */
csbrdf_status csbrdf_block_box(const csbrdf_brdf *brdf, size_t block, size_t origin[4], size_t shape[4]);

/**
 * Decodes one block into `out`, BRDF in 1/sr: one channel after the other, each the block's box with the last axis
 * fastest. Bins that were not measured hold what the encoder filled in.
 *
 * `length` must be what csbrdf_block_size() gives.
 */
csbrdf_status csbrdf_decode_block(const csbrdf_brdf *brdf,
                                  size_t block,
                                  float *out,
                                  size_t length);

/**
 * Decodes the whole table into `out`, BRDF in 1/sr: one channel after the other, each of the shape of the grid with
 * the last axis fastest. Bins that were not measured hold what the encoder filled in. Needs no more memory than one
 * block's besides `out`.
 *
 * `length` must be what csbrdf_table_size() gives.
 */
csbrdf_status csbrdf_decode_all(const csbrdf_brdf *brdf,
                                float *out,
                                size_t length);

/**
 * BRDF in 1/sr of each channel, for light from `wi` and view to `wo`: vectors x, y, z away from the surface in its
 * frame, z along the normal, of any length. 0 if one points below the horizon, is zero or not finite.
 *
 * `channels` is the length of `out` and must be what csbrdf_channel_count() gives. CSBRDF_INVALID_ARGUMENT if the
 * axes of the file are not angles of directions.
 */
csbrdf_status csbrdf_eval(const csbrdf_brdf *brdf,
                          const double wi[3],
                          const double wo[3],
                          float *out,
                          size_t channels);

/**
 * csbrdf_eval() of `count` pairs of directions: `wi` and `wo` hold x, y, z of one after the other (3 * count values),
 * `out` receives all channels of the first pair, then those of the second, and so on.
 *
 * `length` is that of `out`, count times what csbrdf_channel_count() gives.
 */
csbrdf_status csbrdf_eval_many(const csbrdf_brdf *brdf,
                               size_t count,
                               const double *wi,
                               const double *wo,
                               float *out,
                               size_t length);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* CSBRDF_H */
