double norme(double a, double b) { return sqrt(pow(a, 2) + pow(b, 2)); }

double femGrainsContactIterate(femGrains *mesGrains, double pas, int iteration)
{
    int contact = -1;
    double erreur = 0.0;
    for (int bille = 0; bille < mesGrains->n; bille++) {
        for (int voisine = bille + 1; voisine < mesGrains->n; voisine++) {
            contact++;
            double distX = mesGrains->x[voisine] - mesGrains->x[bille];
            double distY = mesGrains->y[voisine] - mesGrains->y[bille];
            double dist = norme(distX, distY);
            double normaleX = distX / dist;
            double normaleY = distY / dist;
            double masseTotale = mesGrains->m[bille] + mesGrains->m[voisine];
            double jeu = dist - (mesGrains->r[bille] + mesGrains->r[voisine]);
            double vitNormale = mesGrains->vx[bille] * normaleX + mesGrains->vy[bille] * normaleY
                              - (mesGrains->vx[voisine] * normaleX + mesGrains->vy[voisine] * normaleY);
            double ancienne = mesGrains->dvContacts[contact];
            double correction;
            if (iteration == 0)
                correction = ancienne;
            else
                correction = fmax(0.0, vitNormale + ancienne - jeu / pas) - ancienne;
            mesGrains->vx[bille] -= correction * normaleX * mesGrains->m[voisine] / masseTotale;
            mesGrains->vy[bille] -= correction * normaleY * mesGrains->m[voisine] / masseTotale;
            mesGrains->vx[voisine] += correction * normaleX * mesGrains->m[bille] / masseTotale;
            mesGrains->vy[voisine] += correction * normaleY * mesGrains->m[bille] / masseTotale;
            if (iteration != 0) {
                mesGrains->dvContacts[contact] += correction;
                if (erreur < fabs(correction)) erreur = fabs(correction);
            }
        }
    }
    for (int bille = 0; bille < mesGrains->n; bille++) {
        double dist = norme(mesGrains->x[bille], mesGrains->y[bille]);
        double normaleX = mesGrains->x[bille] / dist;
        double normaleY = mesGrains->y[bille] / dist;
        double ancienne = mesGrains->dvBoundary[bille];
        double correction = ancienne;
        if (iteration != 0) {
            double vitNormale = mesGrains->vx[bille] * normaleX + mesGrains->vy[bille] * normaleY;
            double jeuExt = (mesGrains->radiusOut - dist - mesGrains->r[bille]) / pas;
            double jeuInt = (dist - mesGrains->radiusIn - mesGrains->r[bille]) / pas;
            double exterieure = fmax(0.0, vitNormale + ancienne - jeuExt);
            double interieure = fmax(0.0, -vitNormale - ancienne - jeuInt);
            correction = exterieure - interieure - ancienne;
            mesGrains->dvBoundary[bille] += correction;
            if (erreur < fabs(correction)) erreur = fabs(correction);
        }
        mesGrains->vx[bille] -= correction * normaleX;
        mesGrains->vy[bille] -= correction * normaleY;
    }
    return erreur;
}
