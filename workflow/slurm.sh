#!/usr/bin/env bash
# Submits the shards of one stage as a Slurm array, and a job that merges them and completes the run.
#   workflow/slurm.sh                       # ingest
#   workflow/slurm.sh ingest --array=3,17   # these shards only; options are those of sbatch, for the array
#   workflow/slurm.sh fit                   # bootstrap, once the tables of the trials exist
# Run it in the folder of pipeline.toml.
set -euo pipefail

trilink=${TRILINK:-trilink} # or "apptainer exec trilink.sif trilink"
parts=${PARTS:-8}
replicates=${REPLICATES:-5000} # for fit: `bootstrap` in pipeline.toml
logs=${LOGS:-logs}

stage=${1:-ingest}
case $stage in
ingest)
    shards=shards
    part="--shard \$SLURM_ARRAY_TASK_ID/$parts"
    ;;
fit)
    shards=boots
    part="--replicates \$(((SLURM_ARRAY_TASK_ID - 1) * $replicates / $parts))..\$((SLURM_ARRAY_TASK_ID * $replicates / $parts))"
    ;;
*)
    echo "found stage '$stage', needed ingest or fit" >&2
    exit 2
    ;;
esac

mkdir -p "$logs"
array=$(sbatch --parsable --job-name="trilink-$stage" --output="$logs/$stage-%A-%a.txt" \
    --array="1-$parts" --cpus-per-task=2 --mem=2G --time=30 "${@:2}" --wrap \
    "$trilink --threads \$SLURM_CPUS_PER_TASK $stage $part --into $shards")
# The merge runs however the shards ended, and names missing ones. Status 1 means that a trial failed.
merge=$(sbatch --parsable --job-name=trilink-merge --output="$logs/merge-%j.txt" \
    --dependency="afterany:${array%;*}" --cpus-per-task=4 --mem=4G --time=60 --wrap \
    "{ $trilink merge $shards || [ \$? = 1 ]; } && $trilink --threads \$SLURM_CPUS_PER_TASK run")
echo "array ${array%;*}, then ${merge%;*}: see $logs/merge-${merge%;*}.txt"
