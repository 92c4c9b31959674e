#!/usr/bin/env bash
# One stage in parts, as a Slurm array, then a job that joins the parts and does the rest of a run.
#   workflow/slurm.sh                       # the ingest
#   workflow/slurm.sh ingest --array=3,17   # these parts of it; options are those of sbatch, for the array
#   workflow/slurm.sh fit                   # the bootstrap, once the tables of the trials are there
# Begin it in the folder of pipeline.toml.
set -euo pipefail

trilink=${TRILINK:-trilink} # or "apptainer exec trilink.sif trilink"
parts=${PARTS:-8}
replicates=${REPLICATES:-5000} # of the fit: `bootstrap` in pipeline.toml
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
# However the parts ended: the merge names those that are missing. Status 1 is a trial that failed.
merge=$(sbatch --parsable --job-name=trilink-merge --output="$logs/merge-%j.txt" \
    --dependency="afterany:${array%;*}" --cpus-per-task=4 --mem=4G --time=60 --wrap \
    "{ $trilink merge $shards || [ \$? = 1 ]; } && $trilink --threads \$SLURM_CPUS_PER_TASK run")
echo "array ${array%;*}, then ${merge%;*}: see $logs/merge-${merge%;*}.txt"
