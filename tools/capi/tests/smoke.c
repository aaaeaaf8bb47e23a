/* Every function of csbrdf.h and every status but CSBRDF_PANIC. Usage: smoke DATA, the folder of golden files. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "csbrdf.h"

static int checks = 0, failures = 0;

static void check(int holds, const char *what, int line) {
    ++checks;
    if (!holds) {
        char message[512];
        ++failures;
        csbrdf_last_error(message, sizeof message);
        fprintf(stderr, "smoke.c:%d: not so: %s (last error: %s)\n", line, what, message);
    }
}

#define CHECK(condition) check((condition) != 0, #condition, __LINE__)
#define FAILS(status, call) check((call) == CSBRDF_##status, #call " is CSBRDF_" #status, __LINE__)

/* Whether the last message has this in it. */
static int says(const char *part) {
    char message[512];
    return csbrdf_last_error(message, sizeof message) < sizeof message && strstr(message, part) != NULL;
}

static void *allocate(size_t size) {
    void *memory = malloc(size > 0 ? size : 1);
    if (memory == NULL) {
        fprintf(stderr, "smoke.c: out of memory\n");
        exit(2);
    }
    return memory;
}

static char *join(const char *folder, const char *name) {
    char *path = allocate(strlen(folder) + strlen(name) + 2);
    sprintf(path, "%s/%s", folder, name);
    return path;
}

static unsigned char *read_file(const char *path, size_t *size) {
    unsigned char *bytes = allocate(1 << 20);
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        fprintf(stderr, "smoke.c: no file %s\n", path);
        exit(2);
    }
    *size = fread(bytes, 1, 1 << 20, file);
    fclose(file);
    return bytes;
}

static csbrdf_options options_of_size(size_t size) {
    csbrdf_options options = {0};
    options.size = size;
    return options;
}

/* Blocks are the parts of the whole table that their boxes say. */
static float *check_decoding(const csbrdf_brdf *brdf) {
    size_t axes = 0, channels = 0, blocks = 0, values = 0, covered = 0, shape[4], b, c, i, j, k, l;
    float *table;
    CHECK(csbrdf_axis_count(brdf, &axes) == CSBRDF_OK && axes >= 1 && axes <= 4);
    CHECK(csbrdf_grid_shape(brdf, shape) == CSBRDF_OK);
    CHECK(csbrdf_channel_count(brdf, &channels) == CSBRDF_OK && channels >= 1);
    CHECK(csbrdf_block_count(brdf, &blocks) == CSBRDF_OK && blocks >= 1);
    CHECK(csbrdf_table_size(brdf, &values) == CSBRDF_OK);
    CHECK(values == shape[0] * shape[1] * shape[2] * shape[3] * channels);
    table = allocate(values * sizeof *table);
    CHECK(csbrdf_decode_all(brdf, table, values) == CSBRDF_OK);
    for (b = 0; b < blocks; ++b) {
        size_t size = 0, at = 0, differ = 0, origin[4], box[4];
        float *block;
        CHECK(csbrdf_block_size(brdf, b, &size) == CSBRDF_OK);
        CHECK(csbrdf_block_box(brdf, b, origin, box) == CSBRDF_OK);
        CHECK(size == box[0] * box[1] * box[2] * box[3] * channels);
        block = allocate(size * sizeof *block);
        CHECK(csbrdf_decode_block(brdf, b, block, size) == CSBRDF_OK);
        for (c = 0; c < channels; ++c)
            for (i = origin[0]; i < origin[0] + box[0]; ++i)
                for (j = origin[1]; j < origin[1] + box[1]; ++j)
                    for (k = origin[2]; k < origin[2] + box[2]; ++k)
                        for (l = origin[3]; l < origin[3] + box[3]; ++l) {
                            size_t position = (((c * shape[0] + i) * shape[1] + j) * shape[2] + k) * shape[3] + l;
                            differ += block[at++] != table[position];
                        }
        CHECK(differ == 0);
        covered += size;
        free(block);
    }
    CHECK(covered == values);
    return table;
}

static const double WI[4][3] = {{0.3, 0.0, 0.9}, {0.0, 0.0, 2.0}, {-0.2, 0.5, 0.7}, {0.6, 0.1, 0.5}};
static const double WO[4][3] = {{-0.5, 0.1, 0.8}, {0.0, 0.0, 1.0}, {0.1, -0.4, 0.9}, {0.5, 0.3, 0.4}};

static void check_eval(const csbrdf_brdf *brdf, const csbrdf_brdf *nearest, const float *table) {
    static const double below[3] = {0.0, 0.6, -0.8};
    float many[12], one[3];
    size_t i, c, j, values = 0;
    CHECK(csbrdf_table_size(brdf, &values) == CSBRDF_OK);
    CHECK(csbrdf_eval_many(brdf, 4, &WI[0][0], &WO[0][0], many, 12) == CSBRDF_OK);
    for (i = 0; i < 4; ++i) {
        CHECK(csbrdf_eval(brdf, WI[i], WO[i], one, 3) == CSBRDF_OK);
        for (c = 0; c < 3; ++c) {
            CHECK(isfinite(one[c]) && one[c] > 0.0f);
            CHECK(one[c] == many[3 * i + c]);
        }
        /* The nearest bin's value is one of the table's. */
        CHECK(csbrdf_eval(nearest, WI[i], WO[i], one, 3) == CSBRDF_OK);
        for (c = 0; c < 3; ++c) {
            const float *plane = table + c * (values / 3);
            for (j = 0; j < values / 3 && plane[j] != one[c]; ++j) {
            }
            CHECK(j < values / 3);
        }
    }
    CHECK(csbrdf_eval(brdf, below, WO[0], one, 3) == CSBRDF_OK && one[0] == 0.0f && one[1] == 0.0f && one[2] == 0.0f);
    CHECK(csbrdf_eval_many(brdf, 0, NULL, NULL, NULL, 0) == CSBRDF_OK);
}

static void check_arguments(const csbrdf_brdf *brdf) {
    size_t n, four[4], blocks = 0, size = 0, values = 0;
    float some[16], *room;
    double d[3] = {0.0, 0.0, 1.0};
    FAILS(INVALID_ARGUMENT, csbrdf_axis_count(NULL, &n));
    CHECK(says("brdf is NULL"));
    FAILS(INVALID_ARGUMENT, csbrdf_axis_count(brdf, NULL));
    CHECK(says("count is NULL"));
    FAILS(INVALID_ARGUMENT, csbrdf_channel_count(NULL, &n));
    FAILS(INVALID_ARGUMENT, csbrdf_channel_count(brdf, NULL));
    FAILS(INVALID_ARGUMENT, csbrdf_block_count(NULL, &n));
    FAILS(INVALID_ARGUMENT, csbrdf_block_count(brdf, NULL));
    FAILS(INVALID_ARGUMENT, csbrdf_table_size(NULL, &n));
    FAILS(INVALID_ARGUMENT, csbrdf_table_size(brdf, NULL));
    FAILS(INVALID_ARGUMENT, csbrdf_grid_shape(NULL, four));
    FAILS(INVALID_ARGUMENT, csbrdf_grid_shape(brdf, NULL));
    FAILS(INVALID_ARGUMENT, csbrdf_block_size(NULL, 0, &n));
    FAILS(INVALID_ARGUMENT, csbrdf_block_size(brdf, 0, NULL));
    FAILS(INVALID_ARGUMENT, csbrdf_block_box(NULL, 0, four, four));
    FAILS(INVALID_ARGUMENT, csbrdf_block_box(brdf, 0, NULL, four));
    FAILS(INVALID_ARGUMENT, csbrdf_block_box(brdf, 0, four, NULL));

    /* Blocks that do not exist, lengths that are wrong. */
    CHECK(csbrdf_block_count(brdf, &blocks) == CSBRDF_OK);
    CHECK(csbrdf_block_size(brdf, 0, &size) == CSBRDF_OK);
    CHECK(csbrdf_table_size(brdf, &values) == CSBRDF_OK);
    room = allocate((values + 1) * sizeof *room);
    FAILS(INVALID_ARGUMENT, csbrdf_block_size(brdf, blocks, &n));
    CHECK(says("does not exist"));
    FAILS(INVALID_ARGUMENT, csbrdf_block_box(brdf, (size_t)-1, four, four));
    FAILS(INVALID_ARGUMENT, csbrdf_decode_block(brdf, blocks, room, size));
    FAILS(INVALID_ARGUMENT, csbrdf_decode_block(brdf, 0, room, size - 1));
    CHECK(says("out must hold"));
    FAILS(INVALID_ARGUMENT, csbrdf_decode_block(brdf, 0, room, (size_t)-1));
    FAILS(INVALID_ARGUMENT, csbrdf_decode_block(brdf, 0, NULL, size));
    FAILS(INVALID_ARGUMENT, csbrdf_decode_block(brdf, 0, NULL, 0));
    FAILS(INVALID_ARGUMENT, csbrdf_decode_block(NULL, 0, room, size));
    FAILS(INVALID_ARGUMENT, csbrdf_decode_all(brdf, room, values + 1));
    FAILS(INVALID_ARGUMENT, csbrdf_decode_all(brdf, NULL, values));
    FAILS(INVALID_ARGUMENT, csbrdf_decode_all(NULL, room, values));
    free(room);

    FAILS(INVALID_ARGUMENT, csbrdf_eval(NULL, d, d, some, 3));
    FAILS(INVALID_ARGUMENT, csbrdf_eval(brdf, NULL, d, some, 3));
    CHECK(says("wi is NULL"));
    FAILS(INVALID_ARGUMENT, csbrdf_eval(brdf, d, NULL, some, 3));
    FAILS(INVALID_ARGUMENT, csbrdf_eval(brdf, d, d, NULL, 3));
    FAILS(INVALID_ARGUMENT, csbrdf_eval(brdf, d, d, some, 4));
    FAILS(INVALID_ARGUMENT, csbrdf_eval(brdf, d, d, some, 0));
    FAILS(INVALID_ARGUMENT, csbrdf_eval_many(brdf, 2, d, d, some, 3));
    FAILS(INVALID_ARGUMENT, csbrdf_eval_many(brdf, (size_t)-1, d, d, some, 3));
    FAILS(INVALID_ARGUMENT, csbrdf_eval_many(NULL, 1, d, d, some, 3));
    FAILS(INVALID_ARGUMENT, csbrdf_eval_many(brdf, 1, NULL, d, some, 3));
    FAILS(INVALID_ARGUMENT, csbrdf_eval_many(brdf, 1, d, NULL, some, 3));
    FAILS(INVALID_ARGUMENT, csbrdf_eval_many(brdf, 1, d, d, NULL, 3));
}

/* Opens a copy with one byte changed. */
static csbrdf_status open_changed(const unsigned char *bytes, size_t size, size_t at, csbrdf_brdf **out) {
    unsigned char *changed = allocate(size);
    csbrdf_status status;
    memcpy(changed, bytes, size);
    changed[at] ^= 0x40;
    status = csbrdf_open_memory(changed, size, out);
    free(changed);
    return status;
}

static void check_files(const char *data, const char *path, const unsigned char *bytes, size_t size) {
    static const char *text = "theta_h,theta_d,phi_d,r,g,b\n";
    static const size_t cuts[5] = {0, 4, 20, 100, 1000};
    char *missing = join(data, "no such file.csbrdf"), *list = join(data, "hashes.txt");
    csbrdf_brdf *brdf;
    float value[3], *block;
    size_t blocks = 0, last = 0, i;

    FAILS(IO, csbrdf_open_path(missing, &brdf));
    CHECK(brdf == NULL && says("no such file.csbrdf"));
    FAILS(IO, csbrdf_open_path(data, &brdf));
    FAILS(INVALID_ARGUMENT, csbrdf_open_path("\xff\xfe", &brdf));
    CHECK(says("UTF-8"));
    FAILS(INVALID_ARGUMENT, csbrdf_open_path(NULL, &brdf));
    FAILS(INVALID_ARGUMENT, csbrdf_open_path(path, NULL));
    FAILS(INVALID_ARGUMENT, csbrdf_open_memory(NULL, 5, &brdf));
    FAILS(INVALID_ARGUMENT, csbrdf_open_memory(bytes, (size_t)-1, &brdf));
    FAILS(INVALID_ARGUMENT, csbrdf_open_memory(bytes, size, NULL));

    FAILS(NOT_CSBRDF, csbrdf_open_path(list, &brdf));
    CHECK(brdf == NULL && says("hashes.txt") && says("not a csbrdf file"));
    FAILS(NOT_CSBRDF, csbrdf_open_memory((const unsigned char *)text, strlen(text), &brdf));
    FAILS(NOT_CSBRDF, csbrdf_open_memory(NULL, 0, &brdf));
    FAILS(UNSUPPORTED_VERSION, open_changed(bytes, size, 8, &brdf));
    CHECK(brdf == NULL && says("version 65.0"));
    for (i = 2; i < 5; ++i) {
        FAILS(TRUNCATED, csbrdf_open_memory(bytes, cuts[i], &brdf));
        CHECK(brdf == NULL && says("truncated"));
    }
    for (i = 0; i < 2; ++i) {
        CHECK(csbrdf_open_memory(bytes, cuts[i], &brdf) != CSBRDF_OK && brdf == NULL);
    }
    FAILS(CORRUPT, open_changed(bytes, size, 40, &brdf));
    CHECK(brdf == NULL && says("corrupt"));

    /* A damaged record costs its own block: the last one here. */
    CHECK(open_changed(bytes, size, size - 12, &brdf) == CSBRDF_OK && brdf != NULL);
    CHECK(csbrdf_block_count(brdf, &blocks) == CSBRDF_OK);
    CHECK(csbrdf_block_size(brdf, blocks - 1, &last) == CSBRDF_OK);
    block = allocate(last * sizeof *block);
    FAILS(CORRUPT, csbrdf_decode_block(brdf, blocks - 1, block, last));
    CHECK(says("corrupt RECS"));
    free(block);
    csbrdf_close(brdf);

    /* Axes that are no directions: opens and decodes, but has no value for directions. */
    {
        char *line = join(data, "dft-1d.csbrdf");
        CHECK(csbrdf_open_path(line, &brdf) == CSBRDF_OK);
        free(check_decoding(brdf));
        FAILS(INVALID_ARGUMENT, csbrdf_eval(brdf, WI[0], WO[0], value, 1));
        CHECK(says("axes"));
        csbrdf_close(brdf);
        free(line);
    }
    free(missing);
    free(list);
}

static void check_options(const char *path, const unsigned char *bytes, size_t size) {
    struct {
        csbrdf_options known;
        size_t later;
    } longer;
    csbrdf_options options = options_of_size(sizeof options);
    csbrdf_brdf *brdf;
    size_t values;
    float *all;
    options.max_block_values = 1;
    FAILS(LIMIT_EXCEEDED, csbrdf_open_path_with(path, &options, &brdf));
    CHECK(brdf == NULL && says("above the limit of 1"));
    FAILS(LIMIT_EXCEEDED, csbrdf_open_memory_with(bytes, size, &options, &brdf));
    options = options_of_size(sizeof options);
    options.max_operations = 1; /* and 4096 a byte */
    options.max_bytes = 1;      /* and 16 a byte */
    options.max_table_values = 1;
    CHECK(csbrdf_open_path_with(path, &options, &brdf) == CSBRDF_OK);
    CHECK(csbrdf_table_size(brdf, &values) == CSBRDF_OK);
    all = malloc(values * sizeof *all);
    CHECK(all != NULL);
    FAILS(LIMIT_EXCEEDED, csbrdf_decode_all(brdf, all, values));
    CHECK(says("above the limit of 1"));
    csbrdf_close(brdf);
    /* A program that was compiled before there were these fields: what is behind its own is not read. */
    options.size = offsetof(csbrdf_options, max_table_values);
    CHECK(csbrdf_open_path_with(path, &options, &brdf) == CSBRDF_OK);
    CHECK(csbrdf_decode_all(brdf, all, values) == CSBRDF_OK);
    csbrdf_close(brdf);
    free(all);
    options = options_of_size(0);
    FAILS(INVALID_ARGUMENT, csbrdf_open_path_with(path, &options, &brdf));
    CHECK(brdf == NULL && says("options.size is 0"));
    options = options_of_size((size_t)-1);
    FAILS(INVALID_ARGUMENT, csbrdf_open_path_with(path, &options, &brdf));
    options = options_of_size(sizeof options);
    options.lookup = 7;
    FAILS(INVALID_ARGUMENT, csbrdf_open_memory_with(bytes, size, &options, &brdf));
    options = options_of_size(sizeof options);
    options.pruned = 2;
    FAILS(INVALID_ARGUMENT, csbrdf_open_memory_with(bytes, size, &options, &brdf));
    longer.known = options_of_size(sizeof longer);
    longer.later = 0;
    CHECK(csbrdf_open_memory_with(bytes, size, &longer.known, &brdf) == CSBRDF_OK);
    csbrdf_close(brdf);
    longer.later = 1;
    FAILS(INVALID_ARGUMENT, csbrdf_open_memory_with(bytes, size, &longer.known, &brdf));
    CHECK(csbrdf_open_memory_with(bytes, size, NULL, &brdf) == CSBRDF_OK);
    csbrdf_close(brdf);
}

static void check_pruned(const char *data) {
    char *path = join(data, "pruned.csbrdf");
    csbrdf_options options = options_of_size(sizeof options);
    csbrdf_brdf *brdf;
    size_t values = 0, i;
    float *block;
    CHECK(csbrdf_open_path(path, &brdf) == CSBRDF_OK);
    CHECK(csbrdf_block_size(brdf, 1, &values) == CSBRDF_OK);
    block = allocate(values * sizeof *block);
    FAILS(PRUNED, csbrdf_decode_block(brdf, 1, block, values));
    CHECK(says("was pruned"));
    CHECK(csbrdf_decode_block(brdf, 0, block, csbrdf_block_size(brdf, 0, &i) == CSBRDF_OK ? i : 0) == CSBRDF_OK);
    csbrdf_close(brdf);
    options.pruned = CSBRDF_PRUNED_COARSE;
    CHECK(csbrdf_open_path_with(path, &options, &brdf) == CSBRDF_OK);
    CHECK(csbrdf_decode_block(brdf, 1, block, values) == CSBRDF_OK);
    CHECK(isfinite(block[0]) && block[0] >= 0.0f);
    csbrdf_close(brdf);
    free(block);
    free(path);
}

/* Axes, channels and validity: those of the golden file, a grid of MERL's kind. */
static void check_about(const csbrdf_brdf *brdf) {
    static const unsigned quantities[3] = {CSBRDF_AXIS_THETA_H, CSBRDF_AXIS_THETA_D, CSBRDF_AXIS_PHI_D};
    static const char *const names[3] = {"R", "G", "B"};
    size_t shape[4], blocks = 0, measured = 0, entries = 0, odd = 0, i, j;
    csbrdf_axis axis;
    char name[8];
    double wavelength = -1.0;
    CHECK(csbrdf_grid_shape(brdf, shape) == CSBRDF_OK);
    for (i = 0; i < 3; ++i) {
        CHECK(csbrdf_grid_axis(brdf, i, &axis) == CSBRDF_OK);
        CHECK(axis.quantity == quantities[i] && axis.power == (i == 0 ? 2u : 1u) && axis.bins == shape[i + 1]);
        CHECK(axis.start == 0.0 && fabs(axis.end - (i == 2 ? 2.0 : 1.0) * 1.5707963267948966) < 1e-12);
        CHECK(csbrdf_channel(brdf, i, name, sizeof name, &wavelength) == CSBRDF_OK);
        CHECK(strcmp(name, names[i]) == 0 && wavelength == 0.0);
    }
    FAILS(INVALID_ARGUMENT, csbrdf_grid_axis(brdf, 3, &axis));
    CHECK(says("axis 3 does not exist"));
    FAILS(INVALID_ARGUMENT, csbrdf_grid_axis(brdf, 0, NULL));
    FAILS(INVALID_ARGUMENT, csbrdf_grid_axis(NULL, 0, &axis));
    FAILS(INVALID_ARGUMENT, csbrdf_channel(brdf, 3, name, sizeof name, NULL));
    FAILS(INVALID_ARGUMENT, csbrdf_channel(brdf, 0, NULL, 1, NULL));
    CHECK(csbrdf_channel(brdf, 0, NULL, 0, NULL) == CSBRDF_OK);
    CHECK(csbrdf_channel(brdf, 0, name, 1, NULL) == CSBRDF_OK && name[0] == '\0');
    CHECK(csbrdf_block_count(brdf, &blocks) == CSBRDF_OK);
    for (i = 0; i < blocks; ++i) {
        size_t size = 0;
        unsigned char *valid;
        CHECK(csbrdf_block_size(brdf, i, &size) == CSBRDF_OK);
        valid = allocate(size);
        memset(valid, 7, size);
        CHECK(csbrdf_block_validity(brdf, i, valid, size) == CSBRDF_OK);
        for (j = 0; j < size; ++j) {
            measured += valid[j];
            odd += valid[j] > 1;
        }
        entries += size;
        FAILS(INVALID_ARGUMENT, csbrdf_block_validity(brdf, i, valid, size - 1));
        FAILS(INVALID_ARGUMENT, csbrdf_block_validity(brdf, i, NULL, size));
        free(valid);
    }
    FAILS(INVALID_ARGUMENT, csbrdf_block_validity(brdf, blocks, NULL, 0));
    /* The file has entries that were measured, and others. */
    CHECK(odd == 0 && measured > 0 && measured < entries);
}

/* Draws are where their density says, and their density integrates to 1: means of 1 / pdf are the hemisphere's 2 pi. */
static void check_importance(const csbrdf_brdf *brdf) {
    const double wi[3] = {0.6, 0.0, 0.8}, below[3] = {0.0, 0.1, -0.5};
    double u[2], wo[3], pdf = 0.0, again = 0.0, sum = 0.0;
    csbrdf_importance *importance = NULL;
    int i, wrong = 0;
    CHECK(csbrdf_importance_new(brdf, &importance) == CSBRDF_OK && importance != NULL);
    if (importance == NULL) {
        return;
    }
    for (i = 0; i < 65536; ++i) {
        u[0] = (i / 256 + 0.5) / 256.0;
        u[1] = (i % 256 + 0.5) / 256.0;
        wrong += csbrdf_importance_sample(importance, wi, u, wo, &pdf) != CSBRDF_OK;
        wrong += csbrdf_importance_pdf(importance, wi, wo, &again) != CSBRDF_OK;
        wrong += !(pdf > 0.0) || fabs(again - pdf) > 1e-6 * pdf || !(wo[2] > 0.0);
        wrong += fabs(wo[0] * wo[0] + wo[1] * wo[1] + wo[2] * wo[2] - 1.0) > 1e-9;
        sum += 1.0 / pdf;
    }
    CHECK(wrong == 0);
    CHECK(fabs(sum / 65536.0 / 6.283185307179586 - 1.0) < 0.03);
    FAILS(INVALID_ARGUMENT, csbrdf_importance_sample(importance, below, u, wo, &pdf));
    CHECK(says("not above the horizon"));
    CHECK(csbrdf_importance_pdf(importance, wi, below, &pdf) == CSBRDF_OK && pdf == 0.0);
    FAILS(INVALID_ARGUMENT, csbrdf_importance_sample(importance, wi, NULL, wo, &pdf));
    FAILS(INVALID_ARGUMENT, csbrdf_importance_sample(importance, wi, u, NULL, &pdf));
    FAILS(INVALID_ARGUMENT, csbrdf_importance_pdf(importance, wi, wo, NULL));
    FAILS(INVALID_ARGUMENT, csbrdf_importance_pdf(NULL, wi, wo, &pdf));
    csbrdf_importance_free(importance);
    csbrdf_importance_free(NULL);
    FAILS(INVALID_ARGUMENT, csbrdf_importance_new(NULL, &importance));
    CHECK(importance == NULL);
    FAILS(INVALID_ARGUMENT, csbrdf_importance_new(brdf, NULL));
}

static void check_messages(void) {
    char message[8] = "#######", whole[64];
    size_t needed;
    FAILS(INVALID_ARGUMENT, csbrdf_axis_count(NULL, NULL));
    needed = csbrdf_last_error(NULL, 0);
    CHECK(needed == strlen("brdf is NULL"));
    CHECK(csbrdf_last_error(message, 5) == needed && strcmp(message, "brdf") == 0 && message[5] == '#');
    CHECK(csbrdf_last_error(whole, needed + 1) == needed && strcmp(whole, "brdf is NULL") == 0);
}

int main(int argc, char **argv) {
    const char *data = argc > 1 ? argv[1] : "../../tests/data/v1";
    char *path = join(data, "dct-dependent-grazing-zeros.csbrdf");
    size_t size = 0, i, values = 0;
    unsigned char *bytes = read_file(path, &size);
    csbrdf_options options = options_of_size(sizeof options);
    csbrdf_brdf *mapped = NULL, *copied = NULL, *nearest = NULL;
    float *table, *again;
    int same = 1;

    CHECK(csbrdf_abi_version() == CSBRDF_ABI_VERSION);
    CHECK(strlen(csbrdf_version()) >= strlen("0.0.0"));
    CHECK(csbrdf_last_error(NULL, 0) == 0);
    csbrdf_close(NULL);
    CHECK(csbrdf_open_path(path, &mapped) == CSBRDF_OK);
    CHECK(csbrdf_open_memory(bytes, size, &copied) == CSBRDF_OK);
    options.lookup = CSBRDF_LOOKUP_NEAREST;
    options.cache_bytes = 1;
    CHECK(csbrdf_open_path_with(path, &options, &nearest) == CSBRDF_OK);
    if (failures == 0) {
        table = check_decoding(mapped);
        again = check_decoding(copied);
        CHECK(csbrdf_table_size(mapped, &values) == CSBRDF_OK);
        for (i = 0; i < values; ++i) {
            same = same && table[i] == again[i] && isfinite(table[i]) && table[i] >= 0.0f;
        }
        CHECK(same);
        check_eval(mapped, nearest, table);
        check_eval(copied, nearest, table);
        check_arguments(mapped);
        check_files(data, path, bytes, size);
        check_options(path, bytes, size);
        check_pruned(data);
        check_about(mapped);
        check_importance(copied);
        check_messages();
        free(table);
        free(again);
    }
    csbrdf_close(mapped);
    csbrdf_close(copied);
    csbrdf_close(nearest);
    free(bytes);
    free(path);
    printf("smoke.c: csbrdf %s, %d checks, %d failed\n", csbrdf_version(), checks, failures);
    return failures == 0 ? 0 : 1;
}
