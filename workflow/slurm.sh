#!/usr/bin/env bash
# Ingests the trials in parts, as a Slurm array, and then joins the parts, fits and draws.
#   workflow/slurm.sh                    # all parts
#   workflow/slurm.sh --array=3,17       # those that `trilink merge --status` names
# Begin it in the folder of pipeline.toml. Options are those of sbatch, for the array.
set -euo pipefail

trilink=${TRILINK:-trilink} # or "apptainer exec trilink.sif trilink"
parts=${PARTS:-8}
shards=${SHARDS:-shards}
logs=${LOGS:-logs}

mkdir -p "$logs"
array=$(sbatch --parsable --job-name=trilink-ingest --output="$logs/ingest-%A-%a.txt" \
    --array="1-$parts" --cpus-per-task=2 --mem=2G --time=30 "$@" --wrap \
    "$trilink --threads \$SLURM_CPUS_PER_TASK ingest --shard \$SLURM_ARRAY_TASK_ID/$parts --into $shards")
# However the parts ended: the merge names those that are missing.
merge=$(sbatch --parsable --job-name=trilink-merge --output="$logs/merge-%j.txt" \
    --dependency="afterany:${array%;*}" --cpus-per-task=4 --mem=4G --time=60 --wrap \
    "{ $trilink merge $shards || [ \$? = 1 ]; } && $trilink --threads \$SLURM_CPUS_PER_TASK run")
echo "array ${array%;*}, then ${merge%;*}: see $logs/merge-${merge%;*}.txt"
