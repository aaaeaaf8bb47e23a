#!/usr/bin/env bash
# Fills corpus/TARGET with what the fuzzer starts from: golden files, inputs of tests/crashes, small ones made here, and
# the .csbrdf files and traces of folders given as arguments.
set -euo pipefail
shopt -s nullglob
cd "$(dirname "$0")"
golden=../tests/data/v1
# Bytes before the file in the inputs of these targets: HEAD of their bodies.
declare -A head=([eval]=64 [stale]=12 [salvage]=12 [capi]=32)

files=("$golden"/*.csbrdf)
traces=()
for folder in "$@"; do
    files+=("$folder"/*.csbrdf)
    traces+=("$folder"/*.trace)
done

mkdir -p corpus/{open,block,file,eval,stale,salvage,repair,structured,prune,trace,encode,merl,samples,args,manifest,capi}

for file in "${files[@]}"; do
    name=$(basename "$file" .csbrdf)
    cp "$file" "corpus/open/$name"
    cp "$file" "corpus/file/$name"
    for target in "${!head[@]}"; do
        { head -c "${head[$target]}" <(yes "$name e"); cat "$file"; } >"corpus/$target/$name"
    done
done

# Each way of damage, at places all over the file.
number=0
for file in "$golden"/*.csbrdf; do
    for way in 1 2 4 8 16 1 1 4; do
        number=$((number + 1)) at=$((number * 7919 % 65536))
        printf -v damage '\\x%x\\xff\\x40\\0\\x3\\0\\x%x\\x%x\\0\\0\\0\\0' $way $((at & 255)) $((at >> 8))
        { printf "$damage" && cat "$file"; } >"corpus/salvage/$number"
    done
done

# A golden file's number; kind of damage, fill, place, length. Its number; what is changed, which, how, three bytes.
for number in $(seq 0 "$(ls "$golden"/*.csbrdf | tail -n +2 | wc -l)"); do
    for kind in $(seq 0 10); do
        place=$((number * 37 + kind * 91))
        printf -v damage '\\x%x\\x%x\\x%x\\x3\\x%x\\x%x\\0' "$number" "$kind" $((number + kind)) $((place & 255)) $((place * 7 & 255))
        printf "$damage" >"corpus/repair/$number-$kind"
    done
    for what in 0 1 2 3 6 9 10 11 12 13 14 15; do
        printf -v change '\\x%x\\x%x\\x%x\\x%x\\x%x\\x80\\x3' "$number" "$what" $((number * 5 & 255)) "$what" $((number * 11 & 255))
        printf "$change" >"corpus/structured/$number-$what"
    done
done

# By the number of the golden file: block and record; detail, channels and blocks.
for number in $(seq 0 "$(ls "$golden"/*.csbrdf | tail -n +2 | wc -l)"); do
    printf "\\x$(printf %x "$number")\\0" >"corpus/block/$number"
    printf "\\x$(printf %x "$number")\\x01\\x00rrrrrrrrrr\\x00\\xff" >"corpus/block/$number-record"
    printf "\\x$(printf %x "$number")\\0\\0\\xaa\\x5f\\xff\\x03" >"corpus/prune/$number"
    printf "\\x$(printf %x "$number")\\x01\\x10\\xff\\xff\\xff\\xff\\xff\\xff\\xff" >"corpus/prune/$number-detail"
    printf "\\x$(printf %x "$number")\\x18\\x00\\xff\\xff\\xff\\xff\\xff\\xff\\xff" >"corpus/prune/$number-channels"
done

printf 'csbrdf trace 1\nblocks 6 index 00000abc\n1-3\n5\n' >corpus/trace/plain
printf 'csbrdf trace 1\r\n# made by hand\r\nblocks 600 index abc\r\n\r\n1-3\r\n500' >corpus/trace/comment
for trace in "${traces[@]}"; do cp "$trace" corpus/trace/; done

# Settings and values: the bytes of the golden files are as good as any.
for file in "$golden"/*.csbrdf; do
    tail -c 600 "$file" >"corpus/encode/$(basename "$file" .csbrdf)"
done
head -c 500 /dev/zero >corpus/encode/zeros
head -c 900 <(yes 'reflectance') >corpus/encode/text

# 90 x 90 x 180 and 360; the star stands for a whole table.
printf 'Z\0\0\0Z\0\0\0\xb4\0\0\0*\0\0\0\0\0\0\xf0?' >corpus/merl/table
printf 'Z\0\0\0Z\0\0\0\x68\x01\0\0*\0\0\0\0\0\0\xf0?\xff\xff\xff\xff' >corpus/merl/table-360
printf 'Z\0\0\0Z\0\0\0\xb4\0\0\0\0\0\0\0\0\0\xf0?' >corpus/merl/short

bins='theta_h_bin,theta_d_bin,phi_d_bin,r,g,b\n'
printf "0${bins}1,2,3,0.1,0.2,0.3\n1,2,3,1,1,1\n4,5,6,,,\n" >corpus/samples/bins
printf "0# csbrdf plan grid=360\n${bins}89,89,359,1e-9,1e12,0\n" >corpus/samples/grid
printf '0r,g,b,theta_h_deg,theta_d_deg,phi_d_deg\n1,2,3,10,20,30\n-1,2,3,1,1,1\n' >corpus/samples/angles
printf '0R,G,B,wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,note\n1,2,3,0.1,0,0.9,-0.3,0.2,0.8,x\n' >corpus/samples/vectors
printf '0r,g,b,theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg\n1,2,3,30,0,35,180\n"1",2,3,0,0,0,0\n' >corpus/samples/instrument

# The command lines of README and the guide, those after a prompt too.
number=0
grep -ohE '^(\$ )?csbrdf [^#;|>]*' ../README.md ../docs/guide/*.md | sed 's/^\$ //' | sort -u | while read -r _ words; do
    number=$((number + 1))
    tr ' ' '\n' <<<"$words" >"corpus/args/guide-$number"
done

cp "$golden"/set/manifest.json corpus/manifest/golden
printf '{"format":"csbrdf-manifest","version":1,"tool":"","materials":[]}' >corpus/manifest/empty

for file in ../tests/crashes/*; do
    name=$(basename "$file")
    cp "$file" "corpus/${name%%[-.]*}/"
done
